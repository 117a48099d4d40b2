import json
import stat
from http.client import HTTPConnection

import pytest

from knotwork.core.errors import InputError
from knotwork.core.runtime.pace import Pace
from knotwork.plugins.sinks.live import MANIFEST
from knotwork.plugins.sinks.live.hand import Hand
from knotwork.plugins.sinks.live.sink import Live

MS = 1_000_000


@pytest.fixture
def live(knotwork_context):
    opened = []

    def make(playback=None, **config):
        context = knotwork_context(MANIFEST, {"port": 0} | config)
        context.playback = playback
        node = Live(context)
        node.open()
        opened.append(node)
        return node, context

    yield make
    for node in opened:
        node.close()


def post(node, **command):
    connection = HTTPConnection("127.0.0.1", node._server.port, timeout=10)
    token = node._server.token
    path = "/command" + (f"?token={token}" if token else "")
    connection.request("POST", path, json.dumps(command), {"Content-Type": "application/json"})
    answer = connection.getresponse()
    text = json.loads(answer.read()).get("error", "")
    connection.close()
    return answer.status, text


def test_stop_and_rearm_become_messages(live):
    node, context = live()
    context.time = 77
    assert post(node, do="stop") == (200, "")
    assert post(node, do="rearm") == (200, "")
    assert [(message.stamp, message.action) for message in context.messages("control")] == [(77, "stop"), (77, "rearm")]
    assert context.counters == {"stop_commands": 1, "rearm_commands": 1}


def test_without_a_policy_that_drives_the_stick_does_nothing(live):
    node, _ = live()
    status, text = post(node, do="stick", who="a", tick=0, forward=1, left=0)
    assert status == 400
    assert "teleop-web" in text


def test_a_stick_that_has_not_seen_a_look_is_late(live):
    node, _ = live()
    assert node.stick() == (0.0, 0.0)
    status, text = post(node, do="stick", who="a", tick=0, forward=1, left=0)
    assert status == 400
    assert "late" in text
    assert node.statistics()["stale_sticks"] == 1


def test_playback_commands(live):
    pace = Pace(None)
    node, _ = live(playback=pace, paused=True)
    assert pace.paused
    assert post(node, do="resume")[0] == 200
    assert not pace.paused
    assert post(node, do="rate", rate=2.5)[0] == 200
    assert pace.rate == 2.5
    assert post(node, do="rate", rate=None)[0] == 200
    assert pace.rate is None
    for rate in (0, -1, "fast", True):
        assert post(node, do="rate", rate=rate)[0] == 400
    assert post(node, do="step", type=3)[0] == 400
    assert post(node, do="pause")[0] == 200
    assert pace.paused


def test_a_robot_cannot_be_paused(live):
    node, _ = live()
    assert post(node, do="pause")[0] == 400


def test_the_token_is_kept_out_of_reports(live):
    node, context = live(host="0.0.0.0")
    note = context.out / "node.url"
    assert stat.S_IMODE(note.stat().st_mode) == 0o600
    token = node._server.token
    assert token in note.read_text()
    assert not any(token in text for _, text in context.reports)
    assert any(str(note) in text for _, text in context.reports)
    assert post(node, do="stop")[0] == 200


def test_a_token_of_ones_own(live, tmp_path):
    (tmp_path / "token").write_text("my-own-token\n")
    node, _ = live(token_file=str(tmp_path / "token"))
    assert node._server.token == "my-own-token"
    (tmp_path / "token").write_text("short\n")
    with pytest.raises(InputError, match="at least 8"):
        live(token_file=str(tmp_path / "token"))
    with pytest.raises(InputError, match="absent"):
        live(token_file=str(tmp_path / "absent"))


class Clock:
    now = 10_000 * MS

    def __call__(self):
        return self.now


@pytest.fixture
def hand():
    Clock.now = 10_000 * MS
    clock = Clock()
    told = {1: 9_900 * MS}
    return Hand(400 * MS, clock, told), clock, told


def move(hand, forward, left=0.0, tick=1, who="a"):
    hand.move({"who": who, "forward": forward, "left": left, "tick": tick})


def test_a_held_stick(hand):
    hand, _, _ = hand
    assert hand.stick() == (0, 0)
    move(hand, 0.5, -0.25)
    assert hand.stick() == (0.5, -0.25)
    move(hand, 0)
    assert hand.stick() == (0, 0)


def test_its_age_counts_from_the_look_it_answers(hand):
    hand, clock, _ = hand
    clock.now += 299 * MS  # the look is 399 ms old, the stick arrives only now
    move(hand, 1)
    assert hand.stick() == (1, 0)
    clock.now += 2 * MS
    assert hand.stick() == (0, 0)
    with pytest.raises(InputError, match="late"):
        move(hand, 1)
    assert hand.counters["stale_sticks"] == 1


def test_what_was_held_up_on_the_way_does_not_drive(hand):
    hand, clock, told = hand
    clock.now += 5_000 * MS  # a burst of what was sent before the connection broke
    told[50] = clock.now
    for _ in range(10):
        with pytest.raises(InputError):
            move(hand, 1)
    assert hand.stick() == (0, 0)


def test_one_hand_at_a_time(hand):
    hand, clock, told = hand
    move(hand, 1, who="a")
    with pytest.raises(InputError, match="somebody else"):
        move(hand, -1, who="b")
    assert hand.stick() == (1, 0)
    move(hand, 0, who="a")  # lets go
    move(hand, -1, who="b")
    assert hand.stick() == (-1, 0)
    clock.now += 1_000 * MS  # or is gone
    told[2] = clock.now
    move(hand, 0.5, who="c", tick=2)
    assert hand.stick() == (0.5, 0)


@pytest.mark.parametrize(
    "command",
    [
        {},
        {"who": "a", "tick": 1, "forward": 2, "left": 0},
        {"who": "a", "tick": 1, "forward": float("nan"), "left": 0},
        {"who": "a", "tick": "1", "forward": 0, "left": 0},
        {"who": 3, "tick": 1, "forward": 0, "left": 0},
        {"who": "a", "tick": 1, "forward": None, "left": 0},
    ],
)
def test_nonsense_is_refused(hand, command):
    hand, _, _ = hand
    with pytest.raises(InputError):
        hand.move(command)
    assert hand.stick() == (0, 0)
