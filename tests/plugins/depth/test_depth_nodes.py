"""Bad input, silence and coming and going of features, at the nodes themselves."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from knotwork.core import geometry
from knotwork.core.errors import InputError
from knotwork.core.messages import CameraPose, CameraTwist, Depths, Features, Odometry, Twist
from knotwork.plugins.drivers import sim_camera
from knotwork.plugins.drivers.sim_camera.driver import SimCamera
from knotwork.plugins.observers import depth_ekf, depth_fixed_gain, triangulation
from knotwork.plugins.observers.depth_ekf.node import DepthEkf
from knotwork.plugins.observers.depth_fixed_gain.node import FixedGain
from knotwork.plugins.observers.triangulation.node import Triangulation
from knotwork.plugins.policies import active_base, single_point, visual_servo
from knotwork.plugins.policies.active_base.policy import ActiveBase
from knotwork.plugins.policies.single_point.policy import SinglePoint
from knotwork.plugins.policies.visual_servo.policy import VisualServo

MS = 1_000_000
OBSERVERS = [(FixedGain, depth_fixed_gain.Config), (DepthEkf, depth_ekf.Config)]


def features(time, ids, points):
    return Features(
        stamp=time * MS, ids=np.array(ids, dtype=np.int64), points=np.array(points, dtype=float).reshape(-1, 2)
    )


def depths(time, ids, points, chi, **more):
    return Depths(
        stamp=time * MS, ids=np.array(ids), points=np.array(points, dtype=float), chi=np.array(chi, dtype=float), **more
    )


@pytest.fixture(params=OBSERVERS, ids=["fixed-gain", "ekf"])
def observer(request, context):
    node, settings = request.param
    return lambda **config: node(context(settings(**config)))


def last(node):
    return node.context.emitted[-1][1]


def test_bad_features_are_skipped_and_counted(observer):
    node = observer()
    node.on_features(features(0, [1, 2, 2, 3], [(0.1, 0), (0.2, 0), (0.3, 0), (math.nan, 0)]))
    assert last(node).ids.tolist() == [1, 2]
    assert last(node).points.tolist() == [[0.1, 0.0], [0.2, 0.0]]
    node.on_features(features(50, [], []))
    assert last(node).ids.size == 0
    node.on_features(Features(stamp=100 * MS, ids=np.array([1, 2]), points=np.zeros((1, 2))))
    assert last(node).ids.size == 0
    node.on_features(features(90, [1], [(0.1, 0)]))  # older than the last one
    node.on_twist(CameraTwist(stamp=0, v=np.array((math.nan, 0, 0)), w=np.zeros(3)))
    assert node.context.counts == {"skipped_features": 2, "malformed_frames": 1, "late_frames": 1, "bad_twists": 1}


def test_features_come_go_and_come_back(observer):
    node = observer(guess={1: 0.5, 2: 2.0}, memory=0.3)
    s = {1: (0.1, 0.0), 2: (-0.1, 0.1), 3: (0.0, 0.2)}
    node.on_features(features(0, [1, 2], [s[1], s[2]]))
    assert last(node).chi.tolist() == [0.5, 2.0]
    node.on_features(features(50, [3, 1], [s[3], s[1]]))
    np.testing.assert_allclose(last(node).chi, [1.0, 0.5], atol=1e-9)
    node.on_features(features(100, [2], [s[2]]))
    np.testing.assert_allclose(last(node).chi, [2.0], atol=1e-9)
    for time in range(150, 700, 50):
        node.on_features(features(time, [2], [s[2]]))
    assert node.tracks.ids.tolist() == [2]
    node.on_features(features(5000, [2], [s[2]]))
    assert node.context.counts == {"gaps": 1}


def test_depths_follow_from_odometry_of_the_base_too(observer):
    """A base drives an arc past points; only its odometry is known."""
    node = observer(offset=0.1, guess=0.4)
    points = np.array([(2.0, 0.4, 0.3), (2.5, -0.5, 0.2), (3.0, 0.3, -0.4)])  # forward, left, up
    x = y = yaw = 0.0
    for k in range(80):
        c, s = math.cos(yaw), math.sin(yaw)
        forward = (points[:, 0] - x) * c + (points[:, 1] - y) * s - 0.1
        left = -(points[:, 0] - x) * s + (points[:, 1] - y) * c
        node.on_odometry(Odometry(stamp=50 * k * MS, pose=np.array((x, y, yaw))))
        node.on_features(features(50 * k, [0, 1, 2], np.column_stack((-left, -points[:, 2])) / forward[:, None]))
        v, w, h = -0.2, 0.3 * math.cos(0.2 * k), 0.05
        x += v * h * math.cos(yaw + w * h / 2)
        y += v * h * math.sin(yaw + w * h / 2)
        yaw += w * h
    wrong = np.abs(last(node).chi * forward - 1)
    assert wrong.max() < (0.02 if isinstance(node, DepthEkf) else 0.3)
    node.on_odometry(Odometry(stamp=0, pose=np.zeros(3), discontinuity=True))
    node.on_features(features(4000, [0], [(0.1, 0.1)]))


def test_a_frame_waits_for_odometry_but_not_for_ever(observer):
    node = observer()
    node.on_odometry(Odometry(stamp=0, pose=np.zeros(3)))
    for k in range(3):
        node.on_features(features(50 * k, [0], [(0.1, 0.1)]))
    assert [message.stamp for _, message in node.context.emitted] == [0]
    node.on_odometry(Odometry(stamp=60 * MS, pose=np.array((0.06, 0.0, 0.0))))
    assert [message.stamp for _, message in node.context.emitted] == [0, 50 * MS]
    np.testing.assert_allclose(node.v, (0.0, 0.0, 1.0), atol=1e-9)
    for k in range(3, 10):
        node.on_features(features(50 * k, [0], [(0.1, 0.1)]))
    assert [message.stamp for _, message in node.context.emitted] == [0, 50 * MS]
    assert node.context.counts["frames_without_motion"] == 3  # those of 100, 150 and 200 ms
    node.on_odometry(Odometry(stamp=70 * MS, pose=np.full(3, np.nan)))
    assert node.context.counts["bad_odometry"] == 1


def test_ignored_features_and_impossible_guesses(observer):
    node = observer(ignore=(2,))
    node.on_features(features(0, [1, 2], [(0, 0), (0.1, 0)]))
    assert last(node).ids.tolist() == [1]
    with pytest.raises(ValidationError, match="positive"):
        observer(guess=-1.0)


def test_triangulation_waits_for_a_pose(context):
    node = Triangulation(context(triangulation.Config()))
    node.on_features(features(0, [1], [(0, 0)]))
    assert not node.context.emitted
    node.on_camera(CameraPose(stamp=0, role="truth", position=np.zeros(3), rotation=np.eye(3)))
    node.on_features(features(0, [1, 1], [(0, 0), (math.nan, 0)]))
    node.on_camera(CameraPose(stamp=0, role="truth", position=np.zeros(3), rotation=np.eye(3)))
    node.on_features(features(50, [1], [(0, 0)]))
    assert math.isnan(last(node).chi[0])
    assert node.context.counts == {"features_without_pose": 1, "skipped_features": 1, "ill_conditioned": 1}


def servo(context, **config):
    config = {"goal": {0: (0.1, 0.0), 1: (0.0, 0.1), 2: (-0.1, 0.0)}, "solver": "compiled"} | config
    return VisualServo(context(visual_servo.Config(**config)))


POINTS = [(0.2, 0.0), (0.1, 0.1), (0.0, 0.0)]


def twists(node):
    return [message for port, message in node.context.emitted if port == "twist"]


def test_a_servo_without_usable_depths_stands(context):
    node = servo(context)
    node.on_depths(depths(0, [7], [(0, 0)], [1.0]))
    node.on_depths(depths(50, [0, 1, 2], POINTS, [math.nan, -1.0, 0.0]))
    assert [message.v.any() or message.w.any() for message in twists(node)] == [False, False]
    assert node.context.counts == {"no_features": 2, "bad_depths": 3}
    node.on_depths(depths(100, [0, 1, 2], POINTS, [1.0, 1.0, 1.0]))
    assert np.linalg.norm(twists(node)[-1].v) > 0.05
    node.open()
    node.context.timer(300 * MS)
    assert len(twists(node)) == 3
    node.context.timer(700 * MS)
    assert not twists(node)[-1].v.any()
    assert node.context.counts["silences"] == 1


def test_a_failed_solve_is_a_stop_and_one_warning(context):
    node = servo(context)
    node.solve = lambda program: None
    for time in range(3):
        node.on_depths(depths(time, [0, 1, 2], POINTS, [1.0, 1.0, 1.0]))
    assert not any(message.v.any() for message in twists(node))
    assert node.context.counts == {"failed_solves": 3}
    assert [level for level, _ in node.context.reports] == ["warning"]
    assert not last(node).solved


def test_phases_follow_the_uncertainty(context):
    node = servo(context, mode="active+")
    phases, exciting = [], []
    for k, e in enumerate((math.inf, 5e-7, 1e-8, 5e-7)):
        energy = np.array([e, 1e-8 if k else math.inf, e])
        node.on_depths(depths(50 * k, [0, 1, 2], POINTS, [1.0, 1.0, 1.0], uncertainty=energy))
        phases.append(last(node).phase)
        exciting.append(last(node).exciting)
    assert phases == [1, 2, 3, 2]
    assert exciting == [True, True, False, False]  # the latch


@pytest.mark.parametrize(
    ("config", "text"),
    [
        ({"solver": "gurobian"}, "gurobian"),
        ({"uncertainty": (1e-6, 1e-7)}, "certain"),
        ({"goal": {0: (math.nan, 0.0)}}, "finite"),
    ],
)
def test_a_servo_that_cannot_work_is_refused(context, config, text):
    with pytest.raises((InputError, ValidationError), match=text):
        servo(context, **config)


def test_an_ideal_servo_hears_the_truth_only(context):
    node = servo(context, mode="ideal")
    node.on_depths(depths(0, [0, 1, 2], POINTS, [1.0, 1.0, 1.0]))
    assert not node.context.emitted
    node.on_truth(depths(0, [0, 1, 2], POINTS, [1.0, 1.0, 1.0], role="truth"))
    assert twists(node)[0].v.any()


def test_a_single_point_policy_stands_when_its_feature_is_gone(context):
    node = SinglePoint(context(single_point.Config(feature=4)))
    node.open()
    node.on_depths(depths(0, [4], [(0.3, 0.1)], [1.0]))
    assert np.linalg.norm(twists(node)[0].v) == pytest.approx(0.1)
    node.on_depths(depths(50, [5], [(0.3, 0.1)], [1.0]))
    node.context.timer(900 * MS)
    assert not twists(node)[-1].v.any()
    assert node.context.counts == {"no_features": 1, "silences": 1}


def test_a_base_that_was_held_back_counts_the_way_by_odometry(context):
    node = ActiveBase(context(active_base.Config(goal={0: (0.1, 0.0), 1: (0.0, 0.1)}, back=0.1, v_max=0.2, pause=0.0)))
    points, x, told = np.array([(0.2, 0.0), (0.1, 0.2)]), 0.0, []
    for k in range(60):
        if k > 20:  # until then something holds it
            x += 0.05 * min(0.0, told[-1])
        node.on_odometry(Odometry(stamp=50 * k * MS, pose=np.array((x, 0.0, 0.0))))
        node.on_depths(Depths(stamp=50 * k * MS, ids=np.arange(2), points=points, chi=np.ones(2), variance=np.ones(2)))
        told.append(next(m.vx for port, m in reversed(node.context.emitted) if port == "twist"))
        if node.context.emitted[-1][1].phase != 1:
            break
    assert k > 25
    assert x == pytest.approx(-0.1, abs=0.011)


def test_a_base_that_loses_its_first_view_comes_back_by_odometry(context):
    node = ActiveBase(context(active_base.Config(back=0.1, v_max=0.2, pause=0.0, swing=0.0, needed=3)))
    pose, command, least, phase = (0.0, 0.0, 0.0), (0.0, 0.0), 0.0, 1
    points = np.array([(0.2, 0.0), (0.1, 0.2), (-0.1, 0.1)])
    for k in range(200):
        pose = geometry.compose(pose, geometry.exp((0.05 * command[0], 0.0, 0.05 * command[1])))
        least = min(least, pose[0])
        node.on_odometry(Odometry(stamp=50 * k * MS, pose=np.array(pose)))
        n = 3 if k == 0 else (2 if phase == 1 else 0)  # too few on the way back, then none
        node.on_depths(
            Depths(stamp=50 * k * MS, ids=np.arange(n), points=points[:n], chi=np.ones(n), variance=np.ones(n))
        )
        command = next((m.vx, m.wz) for port, m in reversed(node.context.emitted) if port == "twist")
        phase = node.context.emitted[-1][1].phase
    assert phase == 2
    assert least == pytest.approx(-0.1, abs=0.011)
    assert math.hypot(pose[0], pose[1]) < 0.01


def test_a_base_without_features_does_not_back_up(context):
    node = ActiveBase(context(active_base.Config(goal={0: (0.1, 0), 1: (0, 0.1)}, pause=0.0)))
    node.open()
    node.on_depths(depths(0, [], np.zeros((0, 2)), [], variance=np.zeros(0)))
    assert twists(node)[-1].vx == 0.0
    node.on_depths(depths(50, [0, 1], [(0.1, 0), (0, 0.1)], [1.0, 1.0], variance=np.ones(2)))
    assert twists(node)[-1].vx == -0.2
    node.context.timer(900 * MS)
    assert twists(node)[-1].vx == 0.0


def camera(context, **config):
    made = context(sim_camera.Config(**({"points": [(0, 0, 1.0), (0, 0, -1.0)], "duration": 0.2} | config)))
    made.seed = 3
    return SimCamera(made)


def test_the_camera_sees_only_what_is_in_front_and_in_view(context):
    with pytest.raises(ValidationError, match="in front"):
        camera(context, points=[(0, 0, -1.0)])
    node = camera(context, points=[(0, 0, 1.0), (0, 0, -1.0), (0.9, 0, 1.0)], view=(0.7, 0.5))
    frames = [item[1] for item in node.events() if isinstance(item, tuple) and item[0] == "features"]
    assert [frame.ids.tolist() for frame in frames] == [[0]] * 5
    assert node.context.counts == {"points_behind": 5}


def test_commands_that_are_old_wrong_or_for_another_camera_do_not_move_it(context):
    node = camera(context, duration=2.0, command_timeout=0.3)
    node.on_twist(Twist(stamp=0, vx=1.0))
    node.on_command(CameraTwist(stamp=0, v=np.array((np.inf, 0, 0)), w=np.zeros(3)))
    steps = node.events()
    applied = []
    for item in steps:
        if isinstance(item, tuple) and item[0] == "applied":
            applied.append(item[1].v[0])
            if len(applied) == 2:
                node.on_command(CameraTwist(stamp=item[1].stamp, v=np.array((0.1, 0, 0)), w=np.zeros(3)))
    # given at frame 1, it holds over the seven steps that start within 0.3 s of it
    assert applied == [0.0] * 2 + [0.1] * 7 + [0.0] * 32
    assert node.context.counts == {
        "ignored_commands": 1, "bad_commands": 1, "command_timeouts": 1, "points_behind": 41,
    }  # fmt: skip


def test_true_velocity_differs_from_the_command_as_told(context):
    node = camera(context, duration=1.0, twist_scale=(1.1, 1, 1, 1, 1, 1), command_timeout=10)
    node.on_command(CameraTwist(stamp=0, v=np.array((0.1, 0, 0)), w=np.zeros(3)))
    list(node.events())
    assert node.position[0] == pytest.approx(0.11)
    node = camera(context, duration=50.0, twist_noise=(0.01, 0.0))
    list(node.events())
    assert 0.01 < np.linalg.norm(node.position) < 0.1  # a random walk of 1000 steps of 0.5 mm
