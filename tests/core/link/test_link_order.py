"""The two halves of a link over a channel that loses, repeats and swaps."""

import random

from hypothesis import given, settings
from hypothesis import strategies as st

from knotwork.core.link.arrivals import Arrivals
from knotwork.core.link.outbox import Outbox


def carried(seed, n, limit, window, loss, outage=(0, 0)):
    """Send n messages of 100 bytes over a bad channel; return the outbox, the arrivals, and what was delivered."""
    rng = random.Random(seed)
    box, arrivals, delivered = Outbox(limit, window), Arrivals(), []
    there, back = [], []
    given_ = step = 0
    while arrivals.expected < n:
        step += 1
        assert step < 200_000, "it never ends"
        down = outage[0] <= step < outage[1]
        if given_ < n and rng.random() < 0.7:
            box.put(f"s.{given_ % 3}", "t", given_.to_bytes(4, "big") + bytes(96), 0)
            given_ += 1
        while (entry := box.take()) is not None:
            if not down and rng.random() >= loss:
                there.append((entry.seq, box.first, entry.payload))
                if rng.random() < loss:
                    there.append(there[-1])
        if there and rng.random() < loss and len(there) > 1:
            there[0], there[-1] = there[-1], there[0]
        for seq, first, payload in there:
            verdict = arrivals.judge(1, seq, first)
            if verdict == "new":
                delivered.append(int.from_bytes(payload[:4], "big"))
            if rng.random() >= loss:
                back.append((arrivals.expected, verdict == "gap"))
        there.clear()
        for expected, gap in back if not down else ():
            box.acknowledge(expected)
            if gap:
                box.rewind()
        back.clear()
        if step % 5 == 0:
            box.rewind(probe=bool(rng.getrandbits(1)))
    return box, arrivals, delivered


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 120), st.floats(0, 0.4), st.integers(228, 5000))
def test_everything_arrives_once_and_in_order(seed, n, loss, window):
    _, arrivals, delivered = carried(seed, n, 10**9, window, loss)
    assert delivered == list(range(n))
    assert arrivals.lost == 0


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32), st.integers(50, 150), st.floats(0, 0.3), st.integers(1, 40), st.integers(10, 300))
def test_a_full_buffer_loses_its_oldest_and_both_ends_count_them(seed, n, loss, room, length):
    box, arrivals, delivered = carried(seed, n, room * 228, 2000, loss, outage=(5, 5 + length))
    assert delivered == sorted(set(delivered))
    before = delivered[0] if not arrivals.lost else n - len(delivered) - arrivals.lost  # nobody had listened yet
    assert len(delivered) + arrivals.lost + before == n
    # What the sender dropped may have arrived before, when only its acknowledgement was lost.
    assert arrivals.lost <= sum(box.lost.values())
    assert n - 1 in delivered


def test_an_outage_within_the_buffer_loses_nothing():
    box, _, delivered = carried(3, 500, 500 * 228, 2000, 0.0, outage=(50, 400))
    assert delivered == list(range(500))
    assert box.lost == {}
    assert box.resent > 0


def test_the_window_is_kept():
    box = Outbox(10**6, 1000)
    for _ in range(10):
        box.put("s", "t", bytes(272), 0)  # 400 with its head
    assert [box.take() is not None for _ in range(4)] == [True, True, False, False]
    box.acknowledge(1)
    assert box.take().seq == 2
    assert box.take() is None


def test_a_probe_is_one_message_until_it_is_answered():
    box = Outbox(10**6, 10**6)
    for _ in range(5):
        box.put("s", "t", b"", 0)
    while box.take():
        pass
    box.rewind(probe=True)
    assert box.take().seq == 0
    assert box.take() is None
    box.acknowledge(1)
    assert [e.seq for e in iter(box.take, None)] == [1, 2, 3, 4]
    assert box.resent == 5


def test_one_message_larger_than_everything_still_goes():
    box = Outbox(100, 100)
    assert box.put("s", "t", bytes(1000), 0) == 0
    assert box.take().seq == 0
    assert box.put("s", "t", bytes(1000), 0) == 1
    assert box.lost == {"s": 1}
    assert box.take() is None  # the first is still on its way
    box.acknowledge(1)
    assert box.take().seq == 1


def test_an_acknowledgement_of_what_was_never_sent_is_ignored():
    box = Outbox(10**6, 10**6)
    box.put("s", "t", b"", 0)
    assert not box.acknowledge(99)
    assert len(box) == 1


def test_a_sender_that_begins_anew():
    arrivals = Arrivals()
    assert arrivals.judge(1, 0, 0) == "new"
    assert arrivals.judge(1, 2, 0) == "gap"
    assert arrivals.judge(2, 0, 0) == "new"
    assert arrivals.judge(2, 0, 0) == "duplicate"
    assert arrivals.judge(2, 5, 5) == "new"
    assert (arrivals.lost, arrivals.sessions) == (4, 2)
