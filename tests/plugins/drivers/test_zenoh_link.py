"""`zenoh-out` and `zenoh-in` over a cable that can be pulled."""

import socket
import time
from types import SimpleNamespace

import numpy as np
import pytest
from tcp_proxy import Proxy

from knotwork.core import clock
from knotwork.core.conformance.samples import core_types, difference, sample
from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.messages import MotionControl, Odometry, Pose, Scan, Twist
from knotwork.core.safety.config import SafetyConfig
from knotwork.core.safety.supervisor import Supervisor

pytest.importorskip("zenoh", reason="needs knotwork[zenoh]")

from knotwork.plugins.drivers.zenoh_in import MANIFEST as IN
from knotwork.plugins.drivers.zenoh_in.driver import ZenohIn
from knotwork.plugins.sinks.zenoh_out import MANIFEST as OUT
from knotwork.plugins.sinks.zenoh_out import sink as out_module

SECOND = 1_000_000_000


def until(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it does not happen"
        time.sleep(0.005)


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


class Cable:
    """An out and an in, in one process, with a proxy between."""

    def __init__(self, make, streams, out=None, into=None, offset=0):
        self.make, self.offset = make, offset
        self.port = free_port()
        self.out_config = {"link": "cable", "listen": [f"tcp/127.0.0.1:{self.port}"]} | (out or {})
        self.out = self.send_anew()
        self.proxy = Proxy(self.port)
        config = {"link": "cable", "connect": [f"tcp/127.0.0.1:{self.proxy.port}"], "streams": streams}
        self.in_context = make(IN, config | (into or {}))
        self.into = ZenohIn(self.in_context)
        self.into.open()
        self.into.start()
        self.number = 0

    def send_anew(self):
        self.out_context = self.make(OUT, self.out_config)
        node = out_module.ZenohOut(self.out_context)
        node.open()
        return node

    def up(self):
        until(lambda: self.into._up)
        return self

    def give(self, stream, message):
        self.out.on_message(stream, message.sealed(max(message.stamp, 0), self.number))
        self.number += 1

    def odometry(self, n, wait=0.0):
        for _ in range(n):
            k = self.number
            self.give("base.odometry", Odometry(stamp=k, pose=np.array([k, 0.0, 0.0])))
            time.sleep(wait)

    def came(self, port):
        return self.in_context.messages(port)

    def close(self):
        self.proxy.stalled = False
        for node in (self.out, self.into):
            node.stop_motion()
        self.into.stop()
        self.out.finish()
        self.out.close()
        self.into.close()
        self.proxy.close()


ODOMETRY = {"odometry": {"stream": "base.odometry", "message": "odometry"}}
TWIST = {"twist": {"stream": "drive.twist", "message": "twist"}}
CONTROL = {"control": {"stream": "live.control", "message": "motion_control"}}


@pytest.fixture
def cable(knotwork_context, monkeypatch):
    laid = []

    def lay(streams, offset=0, **more):
        shifted = SimpleNamespace(epoch=lambda: clock.epoch() + offset, monotonic=clock.monotonic)
        monkeypatch.setattr(out_module, "clock", shifted)  # the other machine's clock
        laid.append(Cable(knotwork_context, streams, **more))
        return laid[-1]

    yield lay
    for each in laid:
        each.close()


def test_every_type_arrives_as_it_was(cable):
    types = [kind for kind in core_types() if kind not in ("twist", "camera_twist", "motion_control")]
    rng = np.random.default_rng(0)
    roles = {kind: getattr(sample(kind, rng, 0, 0, "estimate"), "role", "") for kind in types}
    streams = {kind: {"stream": f"n.{kind}", "message": kind, "role": roles[kind]} for kind in types}
    cable = cable(streams).up()
    sent = {kind: [sample(kind, rng, k, k * SECOND, "estimate") for k in range(5)] for kind in types}
    for k in range(5):
        for kind in types:
            cable.give(f"n.{kind}", sent[kind][k])
    until(lambda: len(cable.came(types[-1])) == 5)
    for kind in types:
        assert len(cable.came(kind)) == 5, kind
        for ours, theirs in zip(sent[kind], cable.came(kind), strict=True):
            assert theirs.seq == -1  # this run numbers them itself
            theirs = theirs.sealed(ours.time, ours.seq)
            assert not difference(ours, theirs)


def test_nothing_is_lost_while_the_cable_is_pulled(cable):
    cable = cable(ODOMETRY).up()
    cable.odometry(50)
    until(lambda: len(cable.came("odometry")) == 50)
    cable.proxy.stalled = True
    cable.odometry(150, wait=0.01)
    until(lambda: any("is lost" in text for _, text in cable.out_context.reports))
    cable.proxy.stalled = False
    cable.odometry(50)
    until(lambda: len(cable.came("odometry")) == 250)
    assert [m.stamp for m in cable.came("odometry")] == list(range(250))
    until(lambda: cable.out.statistics()["waiting"] == 0)
    assert cable.out.statistics()["lost"] == 0
    assert any("is back" in text and "nothing is lost" in text for _, text in cable.out_context.reports)


ROBOT = ODOMETRY | {"scan": {"stream": "lidar.scan", "message": "scan"}}


def drive(cable, seconds):
    """50 Hz of odometry and 5 Hz of scans; return how many of both there were."""
    ranges, begun, n = np.full(360, 2.0, np.float32), time.monotonic(), 0
    while n < 50 * seconds:
        cable.odometry(1)
        n += 1
        if n % 10 == 0:
            beams = {"angle_min": 0.0, "angle_increment": 0.0175, "range_min": 0.1, "range_max": 9.0}
            cable.give("lidar.scan", Scan(stamp=cable.number, scan_id=n // 10, ranges=ranges, **beams))
        time.sleep(max(0.0, begun + n / 50 - time.monotonic()))
    return n + n // 10


@pytest.mark.slow
@pytest.mark.parametrize("how", ["stalled", "cut"])
def test_ten_seconds_without_the_link_lose_nothing_that_the_buffer_holds(cable, how):
    cable = cable(ROBOT).up()
    given = drive(cable, 1)
    if how == "cut":
        cable.proxy.cut()
    cable.proxy.stalled = True
    given += drive(cable, 10)
    waiting = cable.out.statistics()["waiting"]
    cable.proxy.stalled = False
    given += drive(cable, 1)
    until(lambda: cable.into.statistics()["received"] == given, 30)
    until(lambda: cable.out.statistics()["waiting"] == 0)
    assert waiting >= 500  # what was given meanwhile was kept
    arrived = sorted(m.stamp for port in ("odometry", "scan") for m in cable.came(port))
    assert len(arrived) == len(set(arrived)) == given
    for port in ("odometry", "scan"):
        stamps = [m.stamp for m in cable.came(port)]
        assert stamps == sorted(stamps)
    assert cable.out.statistics()["lost"] == cable.into.statistics()["lost"] == 0
    said = [text for _, text in cable.out_context.reports]
    assert len(said) == 2, said
    assert "is lost: messages are kept" in said[0]
    assert "is back after 1" in said[1]
    assert said[1].endswith("nothing is lost")


@pytest.mark.slow
def test_ten_seconds_without_the_link_and_a_small_buffer(cable):
    cable = cable(ROBOT, out={"buffer": 0.1, "window": 0.02}).up()
    given = drive(cable, 1)
    cable.proxy.stalled = True
    given += drive(cable, 10)
    kept = cable.out.statistics()["waiting"]
    cable.proxy.stalled = False
    given += drive(cable, 1)
    until(lambda: cable.out.statistics()["waiting"] == 0, 30)
    until(lambda: cable.into.statistics()["received"] + cable.into.statistics()["lost"] == given)
    sent, arrived = cable.out.statistics(), cable.into.statistics()
    assert 0.9 < sent["kept_max_mb"] / 0.1 <= 1.0  # the bound is used, and held
    assert arrived["received"] >= 50 + kept  # all that was kept has come
    assert 0 < arrived["lost"] <= sent["lost"]
    newest = [m.stamp for m in cable.came("odometry")][-1]
    assert newest >= given - 2  # the oldest are lost, not the newest
    out = [text for _, text in cable.out_context.reports]
    assert sum("the buffer (0.1 MB) is full: the oldest are lost" in text for text in out) == 1
    assert any("lost so far: base.odometry" in text and "lidar.scan" in text for text in out)
    assert any("messages were lost" in text for _, text in cable.in_context.reports)


def test_a_connection_that_breaks_is_made_anew(cable):
    cable = cable(ODOMETRY).up()
    cable.odometry(10)
    until(lambda: len(cable.came("odometry")) == 10)
    cable.proxy.cut()
    cable.odometry(30, wait=0.01)
    cable.proxy.stalled = False
    until(lambda: len(cable.came("odometry")) == 40)
    assert [m.stamp for m in cable.came("odometry")] == list(range(40))


def test_what_the_buffer_cannot_hold_is_lost_and_said(cable):
    cable = cable(ODOMETRY, out={"buffer": 0.02, "window": 0.004}).up()  # some seventy messages
    cable.odometry(20)
    until(lambda: len(cable.came("odometry")) == 20)
    cable.proxy.stalled = True
    time.sleep(0.05)
    cable.odometry(300)
    time.sleep(0.5)
    cable.proxy.stalled = False
    until(lambda: cable.came("odometry")[-1].stamp == 319)
    stamps = [m.stamp for m in cable.came("odometry")]
    assert stamps == sorted(set(stamps))
    until(lambda: cable.out.statistics()["waiting"] == 0)
    lost = cable.out.statistics()["lost"]
    assert lost > 100
    arrivals = cable.into.statistics()
    assert arrivals["received"] + arrivals["lost"] == 320
    assert arrivals["lost"] <= lost
    said = [text for level, text in cable.out_context.reports if level == "error"]
    assert len(said) == 1
    assert "buffer" in said[0]
    assert any("messages were lost" in text for _, text in cable.in_context.reports)


def test_a_log_waits_for_the_other_end(cable):
    cable = cable(ODOMETRY, out={"buffer": 0.01, "when_full": "block"}).up()
    cable.odometry(500)
    until(lambda: len(cable.came("odometry")) == 500)
    assert cable.out.statistics()["lost"] == 0


def test_a_sender_that_begins_anew(cable):
    cable = cable(ODOMETRY).up()
    cable.odometry(5)
    until(lambda: len(cable.came("odometry")) == 5)
    cable.out.finish()
    cable.out.close()
    until(lambda: not cable.into._up)
    cable.out = cable.send_anew()
    cable.odometry(5)
    until(lambda: len(cable.came("odometry")) == 10)
    assert any("began anew" in text for _, text in cable.in_context.reports)
    assert cable.into.statistics()["lost"] == 0


@pytest.mark.parametrize("offset", [-3 * SECOND, 3 * SECOND])
def test_a_command_has_this_clocks_stamp(cable, offset):
    cable = cable(TWIST, offset=offset).up()
    sent = clock.epoch()
    cable.give("drive.twist", Twist(stamp=12345, vx=0.1))
    until(lambda: cable.came("twist"))
    (twist,) = cable.came("twist")
    assert twist.vx == 0.1
    slack = max(cable.into._clock.round_trip, 20_000_000)
    assert sent - slack < twist.stamp < clock.epoch()
    assert cable.into.statistics()["offset_ms"] == pytest.approx(offset / 1e6, abs=slack / 1e6)


@pytest.mark.parametrize("offset", [-3 * SECOND, 3 * SECOND])
def test_commands_that_were_held_up_do_not_move_the_base(cable, offset):
    """The cable is pulled for a second; what was sent meanwhile arrives in a burst."""
    cable = cable(TWIST, offset=offset).up()
    base = Supervisor(SafetyConfig(), 0.16, 0.22, lambda level, text: None)
    cable.proxy.stalled = True
    for _ in range(20):
        cable.give("drive.twist", Twist(stamp=0, vx=0.2))
        time.sleep(0.03)
    time.sleep(0.4)
    cable.proxy.stalled = False
    until(lambda: cable.came("twist"))
    time.sleep(0.2)
    held_up = cable.came("twist")
    assert not any(base.command(t.vx, t.wz, t.stamp, clock.epoch()) for t in held_up)
    assert cable.into.statistics()["late"] >= 1

    def accepted():
        cable.give("drive.twist", Twist(stamp=0, vx=0.1))
        time.sleep(0.05)
        fresh = cable.came("twist")[len(held_up) :]
        return any(base.command(t.vx, t.wz, t.stamp, clock.epoch()) for t in fresh)

    until(accepted)


def test_a_command_whose_age_nobody_knows_is_refused(cable):
    cable = cable(TWIST).up()
    cable.into._done.set()  # no more pings
    cable.into._thread.join()
    time.sleep(0.5)  # nor answers under way
    cable.into._clock.forget()
    cable.into._clock_of = 0
    cable.give("drive.twist", Twist(stamp=0, vx=0.1))
    until(lambda: cable.into.statistics()["refused_commands"] == 1)
    assert cable.came("twist") == []


@pytest.mark.parametrize("how", ["stalled", "cut"])
def test_a_stop_always_arrives_and_an_old_rearm_never(cable, how):
    cable = cable(CONTROL, into={"rearm_age": 2.0}).up()
    cable.give("live.control", MotionControl(stamp=0, action="rearm"))
    until(lambda: len(cable.came("control")) == 1)
    if how == "cut":
        cable.proxy.cut()  # what was under way is gone: all is sent again, and is no younger for it
    cable.proxy.stalled = True
    for action in ("rearm", "stop", "rearm"):
        cable.give("live.control", MotionControl(stamp=0, action=action))
    time.sleep(2.5)
    cable.proxy.stalled = False
    until(lambda: len(cable.came("control")) == 2)
    until(lambda: cable.into.statistics()["refused_commands"] == 2)
    assert [m.action for m in cable.came("control")] == ["rearm", "stop"]


def test_late_odometry_is_moved_on_where_it_is_asked_for(cable):
    both = ODOMETRY | {"now": {"stream": "base.odometry", "message": "odometry", "extrapolate": True}}
    cable = cable(both, offset=3 * SECOND, into={"late": 0.05, "horizon": 30}).up()
    twist = np.array([0.5, 0.0, 0.2])
    cable.proxy.stalled = True
    cable.give("base.odometry", Odometry(stamp=0, pose=np.zeros(3), twist=twist))
    time.sleep(0.5)
    cable.proxy.stalled = False
    until(lambda: cable.came("now"))
    (raw,), (moved,) = cable.came("odometry"), cable.came("now")
    assert raw.stamp == 0
    assert raw.pose.tolist() == [0, 0, 0]
    seconds = moved.stamp * 1e-9
    assert 0.3 < seconds < 5
    turned = 0.2 * seconds
    circle = [0.5 / 0.2 * np.sin(turned), 0.5 / 0.2 * (1 - np.cos(turned)), turned]
    assert moved.pose == pytest.approx(circle, abs=1e-6)
    assert cable.in_context.counters["extrapolated"] == 1
    assert cable.into.statistics()["late"] == 1


def test_the_link_tells_its_state(cable):
    cable = cable(ODOMETRY, offset=3 * SECOND).up()
    cable.odometry(3)
    until(lambda: cable.came("link"))
    state = cable.came("link")[-1]
    assert state.up
    assert state.offset == pytest.approx(3.0, abs=max(state.round_trip, 0.02))
    assert 0 < state.round_trip < 0.5
    assert state.received == 3


def test_that_nobody_answers_is_said_once(knotwork_context):
    context = knotwork_context(IN, {"link": "lonely", "connect": ["tcp/127.0.0.1:9"], "streams": ODOMETRY})
    node = ZenohIn(context)
    node.open()
    node.start()
    until(lambda: context.reports)
    time.sleep(0.2)
    node.stop()
    node.close()
    assert context.reports == [("info", "link lonely: nobody has answered yet (it connects to tcp/127.0.0.1:9)")]


def test_another_type_than_expected_is_said_once(cable):
    cable = cable({"pose": {"stream": "loc.pose", "message": "pose", "role": "estimate"}} | ODOMETRY).up()
    for _ in range(3):
        cable.give("loc.pose", Pose(stamp=0, role="truth", pose=np.zeros(3)))
    cable.odometry(1)
    until(lambda: cable.came("odometry"))
    assert cable.came("pose") == []
    assert cable.in_context.counters["unexpected_messages"] == 3
    assert sum("gives pose (truth)" in text for _, text in cable.in_context.reports) == 1


def test_foreign_data_is_survived(cable):
    cable = cable(ODOMETRY).up()
    for what in ("ack", "ping", "pong", "data/base/odometry"):
        cable.out._session.put(f"knotwork/cable/{what}", b"junk")
        cable.into._session.put(f"knotwork/cable/{what}", b"junk")
    cable.odometry(2)
    until(lambda: len(cable.came("odometry")) == 2)
    until(lambda: cable.in_context.counters.get("unusable_messages", 0) >= 1)


def test_a_taken_endpoint_is_said(knotwork_context):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        config = {"listen": [f"tcp/127.0.0.1:{taken.getsockname()[1]}"]}
        with pytest.raises(KnotworkError, match="cannot open the link"):
            out_module.ZenohOut(knotwork_context(OUT, config)).open()


@pytest.mark.parametrize(
    ("streams", "what"),
    [
        ({"a": {"stream": "x.y", "message": "nonsense"}}, "no message type 'nonsense'"),
        ({"a": {"stream": "x.y", "message": "pose"}}, "role"),
    ],
)
def test_wrong_streams(knotwork_context, streams, what):
    with pytest.raises(InputError, match=what):
        knotwork_context(IN, {"streams": streams})
