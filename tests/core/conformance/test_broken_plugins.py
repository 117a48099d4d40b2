"""The kit finds what it is there to find: each deliberately broken plugin fails the check meant for it."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict, Field

from knotwork.core.conformance import (
    CommandSuite,
    DriverSuite,
    LocalizerSuite,
    MapSuite,
    ObserverSuite,
    PolicySuite,
    SinkSuite,
)
from knotwork.core.contracts import Driver, Observer, Sink
from knotwork.core.errors import KnotworkError
from knotwork.core.manifest import Manifest, PluginConfig, Port
from knotwork.core.messages import Odometry, Pose, Scan, Twist

SUITES = {
    s.kind: s for s in (DriverSuite, MapSuite, LocalizerSuite, ObserverSuite, PolicySuite, SinkSuite, CommandSuite)
}
RNG = np.random.default_rng()  # what a plugin must not do: not seeded
CHECKS = [(kind, name) for kind, suite in SUITES.items() for name in dir(suite) if name.startswith("test_")]
WRONG = (AssertionError, pytest.fail.Exception, KnotworkError)


@pytest.mark.parametrize(("kind", "name"), CHECKS)
def test_a_made_plugin_passes(check, kind, name):
    check(kind, name)


# ---- manifests


class NoUnit(PluginConfig):
    speed: float = Field(1.0, description="how fast")


class NoDescription(PluginConfig):
    name: str = ""


class Inner(PluginConfig):
    gains: tuple[int, ...] = Field((), description="of something")


class Nested(PluginConfig):
    inner: tuple[Inner, ...] = Field((), description="several")


class Loose(BaseModel):
    """Neither frozen nor strict."""


class Mutable(BaseModel):
    model_config = ConfigDict(extra="forbid")


@pytest.mark.parametrize(
    ("model", "says"),
    [
        (NoUnit, "speed is a number without a unit"),
        (NoDescription, "name has no description"),
        (Nested, "inner.gains is a number without a unit"),
        (Loose, "takes unknown keys"),
        (Mutable, "not frozen"),
    ],
)
@pytest.mark.parametrize("field", ["config", "options"])
def test_config_models(made, check, model, says, field):
    with pytest.raises(AssertionError, match=says):
        check("sink", "test_config", manifest=replace(made["sink"].manifest, **{field: model}))


def test_a_typing_error_that_is_swallowed(made, check):
    with pytest.raises(pytest.fail.Exception, match="DID NOT RAISE"):
        check("sink", "test_unknown_key_is_refused", manifest=replace(made["sink"].manifest, config=Loose))


@pytest.mark.parametrize(
    "change", [{"contract": 0}, {"kind": "map"}, {"summary": "two\nlines"}, {"name": "A Name"}], ids=str
)
def test_manifest_fields(made, check, change):
    with pytest.raises(AssertionError):
        check("sink", "test_manifest", manifest=replace(made["sink"].manifest, **change))


@pytest.mark.parametrize(
    "change",
    [
        {"inputs": {"a": Port("no_such_type")}},
        {"outputs": {"a": Port("*")}},
        {"outputs": {"a": Port("pose")}},
        {"outputs": {"a": Port("mine")}, "message_types": {"mine": "knotwork.core.messages:Scan"}},
    ],
    ids=str,
)
def test_message_types(made, check, change):
    with pytest.raises(AssertionError):
        check("observer", "test_message_types", manifest=replace(made["observer"].manifest, **change))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("import numpy\n", "imports numpy"),
        ("import knotwork_heavy.impl\n", "imports knotwork_heavy.impl"),
        ("1 / 0\n", "ZeroDivisionError"),
    ],
)
def test_heavy_manifest(made, check, tmp_path, monkeypatch, text, says):
    package = tmp_path / "src" / "knotwork_heavy"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(text)
    (package / "impl.py").write_text("class Sink: ...\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "src"))
    config = type("Config", (PluginConfig,), {"__module__": "knotwork_heavy"})
    manifest = replace(made["sink"].manifest, config=config, impl="knotwork_heavy.impl:Sink")
    with pytest.raises(AssertionError, match=says):
        check("sink", "test_manifest_is_light", manifest=manifest)


def test_wrong_base_and_missing_handler(made, check):
    with pytest.raises(AssertionError, match="not a Sink"):
        check("sink", "test_implementation", cls=made["map"].cls)
    manifest = replace(made["policy"].manifest, inputs={"pose": Port("pose"), "far-off": Port("scan")})
    with pytest.raises(AssertionError, match=r"no on_far_off\(\)"):
        check("policy", "test_implementation", manifest=manifest)


def test_not_installed():
    suite = type("TestIt", (SinkSuite,), {"plugin": "no-such-sink"})()
    with pytest.raises(pytest.fail.Exception, match="not installed"):
        suite.test_manifest()


def test_a_second_close_that_raises(made, check):
    class Bad(made["sink"].cls):
        def close(self):
            super().close()
            assert not self._closed
            self._closed = True

        _closed = False

    with pytest.raises(AssertionError):
        check("sink", "test_opens_and_closes", cls=Bad)


# ---- drivers

OUT = Manifest("bad", "driver", "bad", "no.such:Class", outputs={"odometry": Port("odometry"), "scan": Port("scan")})


def odometry(stamp, x=0.0):
    return Odometry(stamp=stamp, pose=np.array([x, 0.0, 0.0]))


def scan(number, **changes):
    given = {
        "ranges": np.ones(9, np.float32),
        "angle_min": 0.0,
        "angle_increment": 0.1,
        "range_min": 0.1,
        "range_max": 9.0,
    }
    return Scan(stamp=number, scan_id=number, **(given | changes))


@pytest.mark.parametrize(
    ("name", "events"),
    [
        ("test_gives_declared_messages", lambda: []),
        ("test_gives_declared_messages", lambda: [("other", odometry(0))]),
        ("test_gives_declared_messages", lambda: [("scan", odometry(0))]),
        ("test_gives_declared_messages", lambda: [("odometry", odometry(0.5))]),
        ("test_messages_make_sense", lambda: [("odometry", odometry(0, np.nan))]),
        ("test_messages_make_sense", lambda: [("scan", scan(0)), ("scan", scan(2))]),
        ("test_messages_make_sense", lambda: [("scan", scan(0, ranges=np.ones(9)))]),
        ("test_messages_make_sense", lambda: [("scan", scan(0, ranges=np.full(9, -1, np.float32)))]),
        ("test_messages_make_sense", lambda: [("scan", scan(0, range_max=0.0))]),
        ("test_same_again", lambda: [("odometry", odometry(0, np.random.default_rng().uniform()))]),
        ("test_same_again", lambda: [("odometry", odometry(i)) for i in range(int(RNG.integers(1, 400)))]),
    ],
)  # fmt: skip
def test_drivers(check, name, events):
    class Bad(Driver):
        def events(self):
            yield from events()

    with pytest.raises(WRONG):
        check("driver", name, manifest=OUT, cls=Bad, config={})


def test_a_driver_that_lies_about_its_progress(check):
    class Bad(Driver):
        def events(self):
            yield "odometry", odometry(0)

        def progress(self):
            return 100.0

    with pytest.raises(AssertionError, match="progress"):
        check("driver", "test_gives_declared_messages", manifest=OUT, cls=Bad, config={})


def test_a_device_that_is_silent(check):
    class Mute(Driver):
        def start(self):
            pass

    with pytest.raises(AssertionError, match="no message within"):
        check(
            "driver",
            "test_gives_declared_messages",
            manifest=replace(OUT, push=True),
            cls=Mute,
            config={},
            patience=0.05,
        )


def test_a_device_that_pushes_passes(check):
    import threading

    class Device(Driver):
        def start(self):
            self.thread = threading.Thread(target=self.work)
            self.thread.start()

        def work(self):
            for number in range(25):
                self.context.emit("odometry", odometry(number))

        def stop(self):
            self.thread.join()

    manifest = replace(OUT, push=True)
    check("driver", "test_gives_declared_messages", manifest=manifest, cls=Device, config={})
    with pytest.raises(pytest.skip.Exception):
        check("driver", "test_same_again", manifest=manifest, cls=Device, config={})


# ---- observers and policies

ECHO = Manifest(
    "echo", "observer", "odometry to pose", "no.such:Class",
    inputs={"odometry": Port("odometry"), "scan": Port("scan")}, outputs={"pose": Port("pose", role="prior")},
    provides=("prior",),
)  # fmt: skip


def echo(change=lambda pose: pose, port="pose", before=lambda self, message: None):
    class Echo(Observer):
        seen = 0
        last_scan = None

        def on_scan(self, message):
            self.last_scan = message

        def on_odometry(self, message):
            before(self, message)
            self.seen += 1
            pose = Pose(stamp=message.stamp, role="prior", pose=message.pose)
            self.context.emit(port, change(pose))

    return Echo


def chokes_on_a_jump(self, message):
    if message.discontinuity:
        raise ValueError("jump")


def divides_by_time(self, message):
    if message.stamp == getattr(self, "stamp", -1):
        raise ZeroDivisionError
    self.stamp = message.stamp


def needs_a_scan(self, message):
    return self.last_scan.ranges


OBSERVERS = [
    ("test_ordinary_messages", echo(port="other"), NotImplementedError),
    ("test_ordinary_messages", echo(lambda p: replace(p, role="truth")), NotImplementedError),
    ("test_ordinary_messages", echo(lambda p: replace(p, covariance=-np.eye(3))), NotImplementedError),
    ("test_ordinary_messages", echo(lambda p: replace(p, stamp=0.5)), NotImplementedError),
    ("test_ordinary_messages", echo(before=chokes_on_a_jump), ValueError),
    ("test_same_again", echo(lambda p: replace(p, pose=p.pose + RNG.normal(0, 1e-12, 3))), NotImplementedError),
    ("test_stamps_that_run_backwards", echo(before=divides_by_time), ZeroDivisionError),
    ("test_one_input_alone", echo(before=needs_a_scan), AttributeError),
    ("test_nan_does_not_spread", echo(), NotImplementedError),
]


@pytest.mark.parametrize(("name", "cls", "error"), OBSERVERS)
def test_observers(check, name, cls, error):
    with pytest.raises((*WRONG, error)):
        check("observer", name, manifest=ECHO, cls=cls)


def test_an_observer_that_gives_nothing(check):
    class Mute(Observer):
        def on_odometry(self, message):
            pass

        on_scan = on_odometry

    with pytest.raises(AssertionError, match="no output"):
        check("observer", "test_ordinary_messages", manifest=ECHO, cls=Mute)
    check("observer", "test_ordinary_messages", manifest=ECHO, cls=Mute, gives=False)


@pytest.mark.parametrize("covariance", [-np.eye(3), np.full((3, 3), np.nan), np.eye(2)], ids=["negative", "nan", "2x2"])
def test_a_prior_with_a_bad_covariance(check, covariance):
    from knotwork.core.contracts import PriorEstimate

    cls = echo()
    cls.prior = lambda self, time: PriorEstimate(np.zeros(3), covariance, np.zeros(3))
    with pytest.raises(AssertionError):
        check("observer", "test_prior", manifest=ECHO, cls=cls)


def test_a_type_of_its_own_needs_an_example(check):
    manifest = dataclasses.replace(ECHO, inputs={"odometry": Port("my_type")})
    with pytest.raises(pytest.fail.Exception, match="override `message`"):
        check("observer", "test_ordinary_messages", manifest=manifest, cls=echo())


def test_a_command_of_nan(made, check):
    class Bad(made["policy"].cls):
        def on_pose(self, message):
            self.context.emit("twist", Twist(stamp=0, vx=float("nan")))

    with pytest.raises(AssertionError):
        check("policy", "test_commands_are_finite", cls=Bad)


# ---- sinks and commands


class OpensLate(Sink):
    """Writes at the end only, and keeps silent when it cannot."""

    def on_message(self, stream, message):
        pass

    def close(self):
        if self.context.out.is_dir():
            (self.context.out / "late.txt").write_text("")


class RawOsError(OpensLate):
    def open(self):
        (self.context.out / "file").write_text("")


class Chokes(OpensLate):
    def on_message(self, stream, message):
        if isinstance(message, Scan):
            message.ranges.max()


class NeedsAMessage(OpensLate):
    count = 0

    def finish(self):
        return 1 / self.count


class Complains(OpensLate):
    def on_message(self, stream, message):
        self.context.report("error", "no")


@pytest.mark.parametrize(
    ("name", "broken", "error"),
    [
        ("test_unwritable_folder", OpensLate, AssertionError),
        ("test_unwritable_folder", RawOsError, OSError),
        ("test_extreme_messages", Chokes, ValueError),
        ("test_no_messages", NeedsAMessage, ZeroDivisionError),
        ("test_ordinary_messages", Complains, AssertionError),
    ],
)
def test_sinks(check, name, broken, error):
    with pytest.raises(error):
        check("sink", name, cls=broken)


def test_commands(made, check):
    class Unexplained(made["command"].cls):
        def arguments(self, parser):
            parser.add_argument("--deep")

    class Greedy(made["command"].cls):
        def arguments(self, parser):
            parser.parse_args = lambda words: None

    with pytest.raises(AssertionError, match="--deep has no help"):
        check("command", "test_every_argument_is_explained", cls=Unexplained)
    with pytest.raises(pytest.fail.Exception):
        check("command", "test_help", cls=Greedy)
