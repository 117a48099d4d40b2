"""What the kit is made of: its room against geometry, its map against differences, its context against the runtime."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core import codec
from knotwork.core.conformance import ClosedRegistry, FixedPrior, RecordingContext, Room, RoomMap, difference
from knotwork.core.conformance.room import scan_of
from knotwork.core.conformance.samples import core_types, extremes, sample
from knotwork.core.contracts import Loss, Prior
from knotwork.core.errors import NodeError
from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity
from knotwork.core.message_types import message_types
from knotwork.core.messages import Pose, Twist

LOSSES = Loss.__args__


class Config(PluginConfig):
    speed: float = quantity(1.0, "m/s", "speed")


MANIFEST = Manifest(
    "toy", "policy", "toy", "x:Y", Config, inputs={"a-b": Port("twist")}, outputs={"twist": Port("twist")}
)


def test_pytest_loads_nothing_heavy():
    program = (
        "import sys, knotwork.core.conformance.pytest_plugin; "
        "print(*[m for m in ('numpy', 'scipy', 'numba', 'pydantic', 'pluggy', 'knotwork.core.registry',"
        " 'knotwork.core.messages') if m in sys.modules and m != 'pluggy'])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_the_plugin_is_registered(pytestconfig):
    assert pytestconfig.pluginmanager.has_plugin("knotwork")


def test_unknown_name():
    import knotwork.core.conformance as kit

    assert all(getattr(kit, name) for name in kit.__all__)
    with pytest.raises(AttributeError, match="NoSuite"):
        _ = kit.NoSuite


# ---- the room


@given(
    st.tuples(st.floats(-2.0, 2.0), st.floats(-1.5, 1.5), st.floats(-7, 7)),
    st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-7, 7)),
    st.integers(1, 50),
)
def test_every_beam_ends_on_a_wall(pose, mount, beams):
    room = Room()
    scan = room.scan(np.array(pose), mount=mount, beams=beams)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = pose[0] + c * mount[0] - s * mount[1], pose[1] + s * mount[0] + c * mount[1]
    angles = pose[2] + mount[2] + scan.angle_min + scan.angle_increment * np.arange(beams)
    ends = np.column_stack([x + scan.ranges * np.cos(angles), y + scan.ranges * np.sin(angles)]) - room.middle
    off = np.abs(np.abs(ends) - [room.width / 2, room.depth / 2])
    assert off.min(axis=1).max() < 1e-5
    assert np.all(np.abs(ends) < np.array([room.width / 2, room.depth / 2]) + 1e-5)
    assert np.all(scan.ranges > 0)


def test_distance_has_the_right_sign_and_slope():
    room = Room()
    points = np.random.default_rng(0).uniform(-5, 5, (500, 2))
    distance, gradient = room.distance(points)
    inside = np.all(np.abs(points - room.middle) < [room.width / 2, room.depth / 2], axis=1)
    # Beside a corner the wall's line goes on, so a point outside may be nearer to the other wall's line.
    assert np.all(distance[inside] < 0)
    for axis in range(2):
        step = np.eye(2)[axis] * 1e-6
        numeric = (room.distance(points + step)[0] - room.distance(points - step)[0]) / 2e-6
        assert np.mean(np.abs(numeric - gradient[:, axis]) < 1e-6) > 0.99


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("level", range(3))
def test_the_reference_map_is_right(tmp_path, level, loss):
    chart = RoomMap(RecordingContext(Manifest("room", "map", "", "x:Y"), out=tmp_path))
    pose = np.array([0.3, -0.2, 0.4])
    truth = pose + np.array([0.05, 0.02, -0.03])
    scan = Room().scan(truth, mount=(0.1, 0.05, 0.2))
    alignment = chart.alignment(scan, pose)
    terms = alignment.normal_equations(pose, level, loss)
    r, jacobian = alignment.residuals(pose, level)
    assert alignment.costs(np.array([pose]), level, loss) == pytest.approx(terms.cost)
    for axis in range(3):
        step = np.eye(3)[axis] * 1e-6
        pair = alignment.costs(np.array([pose + step, pose - step]), level, loss)
        assert terms.g[axis] == pytest.approx((pair[0] - pair[1]) / 4e-6, rel=1e-3, abs=1e-3)
        numeric = (alignment.residuals(pose + step, level)[0] - alignment.residuals(pose - step, level)[0]) / 2e-6
        assert np.mean(np.abs(numeric - jacobian[:, axis]) < 1e-4 * np.abs(jacobian).max()) > 0.98
    if loss == "none":
        assert np.allclose(terms.H, jacobian.T @ jacobian)
        assert terms.cost == pytest.approx(float(r @ r))
    assert alignment.inliers(truth, level) == 1.0


def test_the_reference_map_answers_as_a_map(tmp_path):
    chart = RoomMap(RecordingContext(Manifest("room", "map", "", "x:Y"), out=tmp_path))
    cells, side, origin = chart.rasterize(0.1)
    assert cells.shape == (60, 80)
    assert set(np.unique(cells)) == {-1, 0, 100}
    row, column = int((chart.room.middle[1] - origin[1]) / side), int((chart.room.middle[0] - origin[0]) / side)
    assert cells[row, column] == 0
    assert chart.alignment(scan_of([]), np.zeros(3)).inliers(np.zeros(3), 0) == 0.0
    assert isinstance(FixedPrior(np.zeros(3)), Prior)


# ---- messages


def test_every_core_type_has_a_sample_and_survives_the_codec():
    core = {name for name, path in message_types().items() if path.startswith("knotwork.core.")}
    assert core == set(core_types())
    assert core == {message.type_name for _, message in extremes()}
    rng = np.random.default_rng(0)
    ordinary = [sample(name, rng, number, number) for name in core_types() for number in range(20)]
    for message in [*ordinary, *(m for _, m in extremes())]:
        assert difference(message, codec.decode(type(message), codec.encode(message))) == ""
    assert sample("no_such_type", rng, 0, 0) is None


def test_extremes_do_not_run_backwards_too_far():
    stamps = [message.stamp for _, message in extremes()]
    assert max(stamps) < 1 << 63


def test_difference():
    a = Pose(stamp=1, role="prior", pose=np.array([0.0, np.nan, 1.0]))
    assert difference(a, a.copy()) == ""
    assert "pose.pose" in difference(a, replace(a, pose=np.array([-0.0, np.nan, 1.0])))
    assert "pose.lost" in difference(a, replace(a, lost=True))
    assert "pose.covariance" in difference(a, replace(a, covariance=np.eye(3)))
    assert difference(a, Twist(stamp=1, vx=0.0)) == "Pose and Twist"


# ---- context and registry


def test_context_validates_and_records(knotwork_context):
    context = knotwork_context(MANIFEST, {"speed": 2.0}, seed=7)
    assert (context.config.speed, context.options, context.seed) == (2.0, None, 7)
    context.emit("twist", Twist(stamp=0, vx=1.0))
    context.report("info", "hello")
    context.count("n")
    context.count("n", 2)
    with context.measure("part"):
        pass
    assert context.messages("twist")[0].vx == 1.0
    assert (context.reports, context.counters) == ([("info", "hello")], {"n": 3})
    assert context.out.is_dir()


@pytest.mark.parametrize(
    ("port", "message"), [("other", Twist(stamp=0, vx=0.0)), ("twist", Pose(stamp=0, role="prior", pose=np.zeros(3)))]
)
def test_context_refuses_what_the_runtime_refuses(knotwork_context, port, message):
    with pytest.raises(NodeError):
        knotwork_context(MANIFEST).emit(port, message)


def test_context_fires_timers_in_order(knotwork_context):
    context = knotwork_context(MANIFEST)
    fired = []
    context.every(1.0, lambda time: fired.append(("slow", time, context.now())))
    context.every(0.4, lambda time: fired.append(("fast", time, context.now())))
    context.advance(5_000_000_000)  # the first event: timers count from here
    assert fired == []
    context.advance(6_000_000_000)
    assert [(name, time) for name, time, _ in fired] == [
        ("fast", 5_400_000_000),
        ("fast", 5_800_000_000),
        ("slow", 6_000_000_000),
    ]
    assert all(time == now for _, time, now in fired)
    context.advance(0)
    assert context.now() == 6_000_000_000
    with pytest.raises(NodeError):
        context.every(0, print)


def test_give_seals_and_calls_the_handler(knotwork_context):
    class Node:
        got = []

        def on_a_b(self, message):
            self.got.append((message.stamp, message.time, message.seq))

    context, node = knotwork_context(MANIFEST), Node()
    for stamp in (5, 3, 9):
        context.give(node, "a-b", Twist(stamp=stamp, vx=0.0))
    assert node.got == [(5, 5, 0), (3, 5, 1), (9, 9, 2)]


def test_registry_fixture(knotwork_registry):
    registry = knotwork_registry(MANIFEST)
    assert isinstance(registry, ClosedRegistry)
    assert registry.names() == ["toy"]
