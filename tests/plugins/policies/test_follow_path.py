"""Pure pursuit: geometry of the path, and the whole loop with the simulator."""

import subprocess
import sys
from math import hypot

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from knotwork.core.errors import InputError
from knotwork.core.geometry import compose, relative
from knotwork.core.messages import Pose
from knotwork.plugins.drivers.sim2d import Config as SimConfig
from knotwork.plugins.drivers.sim2d.driver import Sim2d
from knotwork.plugins.policies.follow_path import Config
from knotwork.plugins.policies.follow_path.policy import FollowPath
from knotwork.plugins.policies.follow_path.pursuit import Polyline


class FakeContext:
    """What both nodes ask of the runtime."""

    options = None

    def __init__(self, config, seed=0):
        self.name = "node"
        self.config = config
        self.seed = seed
        self.time = 0
        self.sent = []
        self.reports = []
        self.counts = {}

    def emit(self, port, message):
        assert port == "twist"
        self.sent.append(message)

    def now(self):
        return self.time

    def report(self, level, text):
        self.reports.append(text)

    def count(self, name, by=1):
        self.counts[name] = self.counts.get(name, 0) + by


def close_the_loop(sim_config, policy_config, stop_when_done=True):
    """Simulator and policy; the policy gets the true pose as its prior at each step."""
    outside, inside = FakeContext(SimConfig(**sim_config)), FakeContext(Config(**policy_config))
    sim, policy = Sim2d(outside), FollowPath(inside)
    track = []
    for item in sim.events():
        if isinstance(item, int):
            inside.time = item
            continue
        port, message = item
        if port == "odometry":
            pose = np.array(relative(sim.start_pose, sim.base.pose))
            policy.on_pose(Pose(stamp=message.stamp, role="prior", pose=pose))
            sim.on_twist(inside.sent[-1])
            track.append(sim.base.pose)
            if policy.pursuit.done and stop_when_done and sim.base.left == sim.base.right == 0.0:
                break
    return sim, policy, np.array(track), outside, inside


@pytest.mark.parametrize(("world", "seconds"), [("apartment", 320), ("arena", 110), ("room", 80)])
def test_the_tour_ends_at_its_end_and_touches_nothing(world, seconds):
    sim, policy, track, outside, inside = close_the_loop({"world": world, "duration": seconds}, {"world": world})
    assert policy.pursuit.done
    assert inside.reports[0].startswith("end of the path")
    assert outside.counts == {}
    end = sim.world.paths["tour"][-1]
    assert hypot(*(track[-1, :2] - end)) < 0.08
    line = Polyline(sim.world.paths["tour"].tolist())
    dense = np.array([line.point(s) for s in np.arange(0, line.length, 0.02)])
    off = [np.hypot(*(dense - p).T).min() for p in track[::25, :2]]
    assert max(off) < 0.12  # it rounds corners by less than that
    clearance = sim.lidar._obstacles.clearances(track[::10, :2]).min()
    assert clearance > 0.105 + 0.08


def test_waypoints_are_in_the_map_s_frame():
    _, policy, track, _, _ = close_the_loop(
        {"world": "room", "start": (0.5, -0.5, 1.57), "duration": 30},
        {"waypoints": [(0, 0), (1, 0), (1, 0.8)]},
    )
    assert policy.pursuit.done
    expected = compose((0.5, -0.5, 1.57), (1.0, 0.8, 0.0))
    assert hypot(track[-1, 0] - expected[0], track[-1, 1] - expected[1]) < 0.05


def test_a_point_behind_is_first_turned_to_on_the_spot():
    _, policy, track, _, _ = close_the_loop(
        {"world": "room", "duration": 30, "noise": False}, {"waypoints": [(0, 0), (-1, 0)], "yaw_rate": 1.5}
    )
    assert policy.pursuit.done
    turned = np.abs(track[:, 2]) > 2.0
    assert np.abs(track[: turned.argmax(), :2]).max() < 0.01
    assert track[-1, 0] == pytest.approx(-1.0, abs=0.04)


def test_loop_goes_round_for_ever():
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    _, policy, track, _, _ = close_the_loop(
        {"world": "room", "start": (-0.5, -0.5, 0.0), "duration": 60}, {"waypoints": square, "loop": True}
    )
    assert not policy.pursuit.done
    assert policy.pursuit.progress > 10.0  # of 4 m a round
    assert np.abs(track[:, :2]).max() < 0.65


def test_a_lost_robot_stands():
    context = FakeContext(Config(waypoints=[(0, 0), (1, 0)]))
    policy = FollowPath(context)
    policy.on_pose(Pose(stamp=0, role="prior", pose=np.full(3, np.nan)))
    assert context.sent.pop().vx == 0.0
    policy.on_pose(Pose(stamp=0, role="prior", pose=np.zeros(3)))
    policy.on_pose(Pose(stamp=0, role="prior", pose=np.zeros(3), lost=True))
    for lost in (True, True, False):
        policy.on_estimate(Pose(stamp=0, role="estimate", pose=np.zeros(3), lost=lost))
        policy.on_pose(Pose(stamp=0, role="prior", pose=np.zeros(3)))
    assert [m.vx > 0.0 for m in context.sent] == [True, False, False, False, True]
    assert context.sent[1].wz == 0.0
    assert context.reports == ["the pose is lost: waiting", "the pose is found: going on"]


def test_a_command_s_age_counts_from_now():
    context = FakeContext(Config(waypoints=[(0, 0), (1, 0)]))
    context.time = 777
    FollowPath(context).on_pose(Pose(stamp=5, role="prior", pose=np.zeros(3)))
    assert context.sent[0].stamp == 777


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3.14, 3.14))
def test_commands_respect_the_limits_everywhere(x, y, yaw):
    config = Config(waypoints=[(0, 0), (1, 0), (1, 1)], speed=0.3, yaw_rate=0.8, lateral=0.05)
    context = FakeContext(config)
    FollowPath(context).on_pose(Pose(stamp=0, role="prior", pose=np.array((x, y, yaw))))
    (twist,) = context.sent
    assert 0.0 <= twist.vx <= 0.3
    assert abs(twist.wz) <= 0.8 * (1 + 1e-12)
    assert abs(twist.vx * twist.wz) <= 0.05 * (1 + 1e-12)


def test_mistakes():
    for bad in ({}, {"waypoints": [(0, 0)]}, {"waypoints": [(0, 0), (1, 0)], "world": "room"}):
        with pytest.raises(ValidationError):
            Config(**bad)
    with pytest.raises(InputError, match="has no path 'tuor'"):
        FollowPath(FakeContext(Config(world="room", path="tuor")))
    with pytest.raises(InputError, match="two different points"):
        FollowPath(FakeContext(Config(waypoints=[(1, 0), (1, 0)])))


@given(
    st.lists(st.tuples(st.integers(-5, 5), st.integers(-5, 5)), min_size=3, max_size=8, unique=True),
    st.booleans(),
    st.floats(0, 60),
    st.floats(-6, 6),
    st.floats(-6, 6),
)
def test_nearest_is_the_nearest_of_dense_samples(points, closed, first, x, y):
    line = Polyline(points, closed)
    first = first if closed else min(first, line.length)
    last = first + 2.5
    s = line.nearest(x, y, first, last)
    assert first - 1e-9 <= s <= last + 1e-9
    px, py = line.point(s)
    samples = [line.point(a) for a in np.linspace(first, last, 501)]
    best = min(hypot(px_ - x, py_ - y) for px_, py_ in samples)
    assert hypot(px - x, py - y) <= best + 1e-9


def test_nearest_ends_far_along_a_closed_path():
    """Arc length so large that a remainder vanishes when it is added."""
    line = Polyline([(0, 0), (0.1, 0), (0.1, 0.1)], closed=True)
    first = 1e9 * line.length
    assert first <= line.nearest(0.05, 0.0, first, first + 0.5) <= first + 0.5


def test_following_waypoints_needs_no_compiler():
    """On a robot without a simulator, Numba is not loaded."""
    code = (
        "import sys, knotwork.plugins.policies.follow_path.policy;"
        "sys.exit(any(m in sys.modules for m in ('numba', 'scipy')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_planned_way_to_a_goal_is_driven_and_touches_nothing():
    goal = (3.7, 1.15)  # across the arena, between its pillars
    sim, policy, track, outside, _ = close_the_loop(
        {"world": "arena", "duration": 60}, {"world": "arena", "goal": goal, "clearance": 0.2}
    )
    assert policy.pursuit.done
    assert outside.counts == {}  # no bump
    end = compose(sim.start_pose, (*goal, 0.0))[:2]
    assert hypot(*(track[-1, :2] - end)) < 0.08
    gaps = [np.abs(np.hypot(*(track[:, :2] - (a[0], a[1])).T) - a[2]).min() for a in sim.world.arcs]
    assert min(gaps) > 0.17  # planned with 0.2; pursuit cuts a little
    for x1, y1, x2, y2 in sim.world.segments:
        edge, start = np.array([x2 - x1, y2 - y1]), np.array([x1, y1])
        share = np.clip((track[:, :2] - start) @ edge / (edge @ edge), 0, 1)
        assert np.linalg.norm(track[:, :2] - start - share[:, None] * edge, axis=1).min() > 0.17


def test_a_goal_that_cannot_be_reached_is_said_with_the_node():
    with pytest.raises(InputError, match=r"node node.*from an obstacle"):
        FollowPath(FakeContext(Config(world="apartment", goal=(0.0, 0.8))))
    for wrong in ({"goal": (1.0, 0.0)}, {"world": "room", "goal": (1.0, 0.0), "loop": True}):
        with pytest.raises(ValidationError):
            Config(**wrong)
