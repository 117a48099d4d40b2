from threading import Thread

from toy_impl import twist

from knotwork.core.graph import Stream
from knotwork.core.runtime.dispatcher import Outlet
from knotwork.core.runtime.inbox import Channel, Inbox


def outlet(size, policy):
    return Outlet(Stream("n", "p", "twist", ""), "n.p", Channel(size, policy))


def taken(inbox):
    entries = []
    while (entry := inbox.take(0)) is not None:
        entries.append(entry.message.stamp)
    return entries


def test_a_full_queue_drops_its_oldest_and_counts():
    inbox, out = Inbox(), outlet(3, "drop-oldest")
    for stamp in range(10):
        inbox.put(out, twist(stamp))
    assert taken(inbox) == [7, 8, 9]
    assert out.channel.drops == 7


def test_latest_keeps_one_and_other_streams_are_left_alone():
    inbox, fast, slow = Inbox(), outlet(100, "latest"), outlet(100, "drop-oldest")
    inbox.put(slow, twist(0))
    for stamp in range(1, 5):
        inbox.put(fast, twist(stamp))
    inbox.put(slow, twist(5))
    assert taken(inbox) == [0, 4, 5]
    assert (fast.channel.drops, slow.channel.drops) == (3, 0)


def test_a_blocking_queue_loses_nothing_and_keeps_its_bound():
    inbox, out = Inbox(), outlet(2, "block")
    thread = Thread(target=lambda: [inbox.put(out, twist(s)) for s in range(50)])
    thread.start()
    seen = []
    while len(seen) < 50:
        entry = inbox.take(5.0)
        assert entry is not None
        seen.append(entry.message.stamp)
        assert len(out.channel.waiting) <= 2
    thread.join()
    assert seen == list(range(50))
    assert out.channel.drops == 0


def test_closing_frees_a_blocked_sender_and_counts_what_it_could_not_leave():
    inbox, out = Inbox(), outlet(1, "block")
    inbox.put(out, twist(0))
    thread = Thread(target=lambda: inbox.put(out, twist(1)))
    thread.start()
    inbox.close()
    thread.join(5.0)
    assert not thread.is_alive()
    assert out.channel.drops == 1
