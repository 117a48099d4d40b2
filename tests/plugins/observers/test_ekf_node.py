import math

import numpy as np
import pytest

from knotwork.core.contracts import Prior
from knotwork.core.geometry import compose, exp, inverse, relative, scaled
from knotwork.core.messages import Odometry, Pose, Scan
from knotwork.plugins.observers.ekf import MANIFEST, EkfConfig

MS = 1_000_000
S = 1000 * MS
SURE = np.diag([1e-4, 1e-4, 1e-4])


def odometry(time, pose, stamp=None, **more):
    stamp = time if stamp is None else stamp
    return Odometry(stamp=stamp, pose=np.array(pose, float), **more).sealed(time, 0)


def scan(time, scan_id, stamp=None):
    return Scan(
        stamp=time if stamp is None else stamp,
        scan_id=scan_id,
        ranges=np.ones(3, np.float32),
        angle_min=0.0,
        angle_increment=0.1,
        range_min=0.1,
        range_max=10.0,
    ).sealed(time, 0)


def correction(time, pose, stamp=None, scan_id=-1, covariance=SURE, **more):
    return Pose(
        stamp=time if stamp is None else stamp,
        role="estimate",
        pose=np.array(pose, float),
        covariance=covariance,
        scan_id=scan_id,
        **more,
    ).sealed(time, 0)


def transforms(ekf):
    return [m.pose for port, m in ekf.context.emitted if port == "transform"]


def test_ports_fit_the_methods(make_ekf):
    ekf = make_ekf()
    assert isinstance(ekf, Prior)
    assert all(hasattr(ekf, f"on_{name}") for name in MANIFEST.inputs)
    assert MANIFEST.inputs["correction"].feedback


def test_before_anything_the_robot_is_at_the_start(make_ekf):
    got = make_ekf(start=(1.0, 2.0, 0.5)).prior(5 * S)
    np.testing.assert_array_equal(got.pose, [1.0, 2.0, 0.5])
    assert got.covariance.max() < 1e-5
    assert not got.weak


def test_the_first_odometry_is_the_start_wherever_odom_has_its_origin(make_ekf):
    ekf = make_ekf()
    ekf.on_odometry(odometry(0, [7.0, 8.0, 1.0]))
    np.testing.assert_array_equal(ekf.prior(0).pose, 0)
    ekf.on_odometry(odometry(100 * MS, [7.0 + math.cos(1.0), 8.0 + math.sin(1.0), 1.0]))
    np.testing.assert_allclose(ekf.prior(100 * MS).pose, [1.0, 0.0, 0.0], atol=1e-12)


def test_each_odometry_gives_a_prior_with_its_stamp(make_ekf):
    ekf = make_ekf()
    ekf.on_odometry(odometry(5 * S, [0, 0, 0], stamp=4 * S))
    ((port, message),) = ekf.context.emitted
    assert (port, message.role, message.stamp, message.scan_id) == ("prior", "prior", 4 * S, -1)
    assert message.covariance.shape == (3, 3)


def test_odometry_of_the_same_time_is_in_the_prior(make_ekf):
    ekf = make_ekf()
    for x in (0.0, 0.1, 0.2, 0.3):
        ekf.on_odometry(odometry(S, [x, 0, 0]))
    np.testing.assert_allclose(ekf.prior(S).pose, [0.3, 0, 0], atol=1e-12)


def test_a_scan_between_odometry_of_the_same_time_keeps_its_place(make_ekf):
    # A burst: two scans and two odometry messages share a time; the first scan's pose comes last.
    ekf = make_ekf()
    ekf.on_odometry(odometry(S, [0.0, 0, 0]))
    ekf.on_scan(scan(S, 0, stamp=S))
    ekf.on_odometry(odometry(S, [0.5, 0, 0], stamp=S - 300 * MS))
    ekf.on_scan(scan(S, 1, stamp=S - 300 * MS))
    ekf.on_correction(correction(S, [0.0, 2.0, 0.0], stamp=S, scan_id=0, prior_included=True))
    np.testing.assert_allclose(ekf.prior(S).pose, [0.5, 2.0, 0.0], atol=1e-12)


def test_inside_the_buffer_the_prior_interpolates_and_beyond_it_goes_on_for_the_horizon(make_ekf):
    ekf = make_ekf(horizon=0.5, weak_motion=(9.0, 9.0))
    for i in range(11):
        ekf.on_odometry(odometry(i * 100 * MS, [0.05 * i, 0, 0]))
    np.testing.assert_allclose(ekf.prior(450 * MS).pose, [0.225, 0, 0], atol=1e-12)
    np.testing.assert_allclose(ekf.prior(450 * MS).twist, [0.5, 0, 0], atol=1e-9)
    np.testing.assert_allclose(ekf.prior(1200 * MS).pose, [0.6, 0, 0], atol=1e-9)
    sigmas = [np.trace(ekf.prior(t * 100 * MS).covariance) for t in range(30)]
    assert np.all(np.diff(sigmas) > 0)
    far, further = ekf.prior(4 * S), ekf.prior(40 * S)
    np.testing.assert_allclose(far.pose, [0.75, 0, 0], atol=1e-9)
    np.testing.assert_array_equal(far.pose, further.pose)
    assert not ekf.prior(1900 * MS).weak
    assert far.weak
    assert not far.twist.any()


def test_before_the_buffer_the_oldest_state_is_a_weak_answer(make_ekf):
    ekf = make_ekf()
    ekf.on_odometry(odometry(S, [0, 0, 0]))
    assert ekf.prior(0).weak
    np.testing.assert_array_equal(ekf.prior(0).pose, 0)


def test_a_question_changes_nothing(make_ekf):
    a, b = make_ekf(), make_ekf()
    for i in range(20):
        for ekf in (a, b):
            ekf.on_odometry(odometry(i * 70 * MS, [0.03 * i, 0, 0.02 * i]))
        for t in range(0, 3000, 130):
            a.prior(t * MS)
    np.testing.assert_array_equal(a.prior(1400 * MS).covariance, b.prior(1400 * MS).covariance)


def test_replacing_and_correcting(make_ekf):
    for included in (True, False):
        ekf = make_ekf(start_sigma=(0.1, 0.1))
        ekf.on_odometry(odometry(0, [0, 0, 0]))
        ekf.on_correction(correction(0, [0.1, 0, 0], covariance=np.diag([0.01, 0.02, 0.03]), prior_included=included))
        got = ekf.prior(0)
        if included:
            np.testing.assert_array_equal(got.pose, [0.1, 0, 0])
            np.testing.assert_array_equal(got.covariance, np.diag([0.01, 0.02, 0.03]))
        else:
            np.testing.assert_allclose(got.pose, [0.05, 0, 0], atol=1e-12)
            np.testing.assert_allclose(got.covariance[0, 0], 0.005, atol=1e-12)


def test_what_the_scan_alone_says_is_used_when_the_prior_is_not_included(make_ekf):
    ekf = make_ekf(start_sigma=(0.1, 0.1))
    ekf.on_odometry(odometry(0, [0, 0, 0]))
    message = correction(
        0,
        [99.0, 99.0, 0.0],
        scan_pose=np.array([5.0, 0.1, 0.0]),
        scan_information=np.diag([0.0, 100.0, 100.0]),
    )
    ekf.on_correction(message)
    np.testing.assert_allclose(ekf.prior(0).pose, [0.0, 0.05, 0.0], atol=1e-12)


def test_transform_is_odom_in_map(make_ekf):
    ekf = make_ekf()
    ekf.on_odometry(odometry(0, [7.0, 8.0, 1.0]))
    ekf.on_odometry(odometry(100 * MS, [7.5, 8.5, 1.2]))
    ekf.on_correction(correction(100 * MS, [0.6, 0.1, 0.15], prior_included=True))
    (pose,) = transforms(ekf)
    np.testing.assert_allclose(pose, compose((0.6, 0.1, 0.15), inverse((7.5, 8.5, 1.2))), atol=1e-12)


def test_lost_is_counted_and_not_believed(make_ekf):
    ekf = make_ekf()
    ekf.on_odometry(odometry(0, [0, 0, 0]))
    ekf.on_correction(correction(0, [0.1, 0, 0], prior_included=True, lost=True))
    np.testing.assert_array_equal(ekf.prior(0).pose, 0)
    assert ekf.context.counts == {"lost_corrections": 1}


def test_wild_corrections_are_refused_then_believed(make_ekf):
    ekf = make_ekf(gate_patience=3)
    ekf.on_odometry(odometry(0, [0, 0, 0]))
    ekf.on_correction(correction(0, [0, 0, 0], prior_included=True))
    for i in range(1, 4):
        ekf.on_odometry(odometry(i * 200 * MS, [0, 0, 0]))
        ekf.on_correction(correction(i * 200 * MS, [4, 0, 0]))
        got = ekf.prior(i * 200 * MS)
        np.testing.assert_array_equal(got.pose, 0)
        assert got.weak
    ekf.on_correction(correction(600 * MS, [4, 0, 0], scan_id=3))
    got = ekf.prior(600 * MS)
    np.testing.assert_allclose(got.pose, [4, 0, 0], atol=1e-3)
    assert not got.weak
    assert ekf.context.counts == {"refused_corrections": 3, "forced_corrections": 1}
    assert [level for level, _ in ekf.context.reports] == ["warning", "warning"]


def test_a_correction_with_the_prior_in_it_is_never_refused(make_ekf):
    ekf = make_ekf()
    ekf.on_odometry(odometry(0, [0, 0, 0]))
    ekf.on_correction(correction(0, [4, 1, 0.5], prior_included=True))
    np.testing.assert_array_equal(ekf.prior(0).pose, [4, 1, 0.5])
    assert ekf.context.counts == {}


def test_a_forced_correction_without_the_prior_moves_the_state_too(make_ekf):
    ekf = make_ekf(gate_patience=1)
    ekf.on_odometry(odometry(0, [0, 0, 0]))
    for i in range(2):
        ekf.on_correction(correction(0, [4, 1, 0.5], scan_id=i))
    np.testing.assert_allclose(ekf.prior(0).pose, [4, 1, 0.5], atol=1e-3)


def test_one_wild_correction_among_good_ones_never_wins(make_ekf):
    ekf = make_ekf(gate_patience=2)
    for i in range(12):
        ekf.on_odometry(odometry(i * 200 * MS, [0.01 * i, 0, 0]))
        x = 0.01 * i + (3.0 if i % 2 else 0.0)
        ekf.on_correction(correction(i * 200 * MS, [x, 0, 0]))
    assert ekf.context.counts == {"refused_corrections": 6}
    assert ekf.prior(2200 * MS).pose[0] == pytest.approx(0.11, abs=1e-3)


def test_a_small_disagreement_is_never_wild_however_sure_the_filter(make_ekf):
    ekf = make_ekf(start_sigma=(1e-6, 1e-6))
    ekf.on_odometry(odometry(0, [0, 0, 0]))
    ekf.on_correction(correction(0, [0.15, 0, 0.1], covariance=1e-10 * np.eye(3), prior_included=True))
    np.testing.assert_array_equal(ekf.prior(0).pose, [0.15, 0, 0.1])


def test_a_discontinuity_inflates_and_is_weak_until_the_next_correction(make_ekf):
    ekf = make_ekf()
    for i in range(5):
        ekf.on_odometry(odometry(i * 100 * MS, [0.1 * i, 0, 0]))
    before = ekf.prior(400 * MS)
    ekf.on_odometry(odometry(500 * MS, [-50.0, 3.0, 2.0], discontinuity=True))
    got = ekf.prior(500 * MS)
    np.testing.assert_array_equal(got.pose, before.pose)
    assert got.covariance[0, 0] > before.covariance[0, 0] + 0.2
    assert got.weak
    assert not got.twist.any()
    np.testing.assert_allclose(ekf.prior(450 * MS).pose, [0.45, 0, 0], atol=1e-9)  # not towards the jump
    ekf.on_odometry(odometry(600 * MS, [-50.0 + 0.1 * math.cos(2.0), 3.0 + 0.1 * math.sin(2.0), 2.0]))
    got = ekf.prior(600 * MS)
    np.testing.assert_allclose(got.pose, [0.5, 0, 0], atol=1e-12)
    assert got.weak
    ekf.on_correction(correction(600 * MS, [0.9, 0.1, 0.1], prior_included=True))
    assert not ekf.prior(600 * MS).weak
    assert ekf.context.counts == {"discontinuities": 1}


@pytest.mark.parametrize(("moved", "weak"), [(0.05, False), (0.4, True)])
def test_a_gap_in_time_counts_only_if_odometry_moved(make_ekf, moved, weak):
    ekf = make_ekf()
    ekf.on_odometry(odometry(0, [0, 0, 0]))
    assert ekf.prior(1500 * MS).weak
    ekf.on_odometry(odometry(1500 * MS, [moved, 0, 0]))
    got = ekf.prior(1500 * MS)
    assert got.pose[0] == pytest.approx(moved)
    assert got.weak == weak


@pytest.mark.parametrize(("step", "weak"), [((0.3, 0.0), False), ((0.6, 0.0), True), ((0.0, 0.6), True)])
def test_large_motion_since_the_last_correction_is_weak(make_ekf, step, weak):
    ekf = make_ekf()
    ekf.on_odometry(odometry(0, [0, 0, 0]))
    ekf.on_odometry(odometry(200 * MS, [step[0], 0, step[1]]))
    assert ekf.prior(200 * MS).weak == weak
    ekf.on_correction(correction(200 * MS, [step[0], 0, step[1]], prior_included=True))
    assert not ekf.prior(200 * MS).weak


def test_heading_stays_in_range_over_many_turns(make_ekf):
    ekf = make_ekf()
    for i in range(200):
        yaw = 0.2 * i
        ekf.on_odometry(odometry(i * 50 * MS, [0, 0, yaw]))
        got = ekf.prior(i * 50 * MS).pose[2]
        assert -math.pi < got <= math.pi
        assert abs(math.remainder(got - yaw, math.tau)) < 0.02
        # The measured yaw sits on the other side of the seam every now and then.
        ekf.on_correction(correction(i * 50 * MS, [0, 0, math.remainder(yaw + 0.01, math.tau)], scan_id=i))
    assert "refused_corrections" not in ekf.context.counts


def test_the_twist_is_the_motion_that_follows_where_it_is_known(make_ekf):
    """A scan that begins at a time is skewed by the motion after it, not by what one message says."""
    ekf = make_ekf()
    path = [(0.2 * t, 0.02 * t * t, 0.4 * t * t) for t in np.arange(0.0, 1.01, 0.02)]
    for i, pose in enumerate(path):
        ekf.on_odometry(odometry(i * 20 * MS, pose, twist=np.array([9.0 * (-1) ** i, 0.0, 5.0])))
    start, end = 610 * MS, 860 * MS  # a quarter of a second later
    motion = exp(scaled(tuple(ekf.prior(start).twist), (end - start) / S))
    expected = relative(tuple(ekf.prior(start).pose), tuple(ekf.prior(end).pose))
    np.testing.assert_allclose(motion, expected, atol=1e-9)
    # near the end there is less of it, at the end none: then the newest message says
    motion = exp(scaled(tuple(ekf.prior(900 * MS).twist), 0.1))
    np.testing.assert_allclose(motion, relative(path[45], path[50]), atol=1e-9)
    np.testing.assert_array_equal(ekf.prior(1000 * MS).twist, [9.0, 0.0, 5.0])


def test_the_motion_that_follows_ends_at_a_jump(make_ekf):
    ekf = make_ekf()
    for i in range(11):
        ekf.on_odometry(odometry(i * 20 * MS, [0.01 * i, 0.0, 0.0]))
    ekf.on_odometry(odometry(220 * MS, [5.0, 5.0, 1.0], discontinuity=True))
    np.testing.assert_allclose(ekf.prior(100 * MS).twist, [0.5, 0.0, 0.0], atol=1e-9)


def test_twist_of_the_message_is_preferred_and_wild_times_give_none(make_ekf):
    ekf = make_ekf()
    ekf.on_odometry(odometry(0, [0, 0, 0]))
    ekf.on_odometry(odometry(100 * MS, [0.05, 0, 0], twist=np.array([0.4, 0.0, 0.1])))
    np.testing.assert_array_equal(ekf.prior(100 * MS).twist, [0.4, 0.0, 0.1])
    ekf.on_odometry(odometry(101 * MS, [0.10, 0, 0]))  # a burst: 1 ms after 5 cm
    np.testing.assert_allclose(ekf.prior(101 * MS).twist, [0.1 / 0.101, 0, 0], rtol=1e-9)
    ekf = make_ekf()
    for i in range(5):
        ekf.on_odometry(odometry(i * MS, [0.05 * i, 0, 0]))
    assert not ekf.prior(4 * MS).twist.any()
    ekf.on_odometry(odometry(60 * MS, [0.50, 0, 0]))  # 0.3 m in 56 ms
    assert not ekf.prior(60 * MS).twist.any()


def test_corrections_older_than_the_buffer_are_counted_and_reported_once(make_ekf):
    ekf = make_ekf(buffer=2.0)
    for i in range(100):
        ekf.on_odometry(odometry(i * 100 * MS, [0.01 * i, 0, 0]))
    before = ekf.prior(9900 * MS)
    for time in (S, 2 * S, 7800 * MS):
        ekf.on_correction(correction(time, [0.2, 0, 0], prior_included=True))
    assert ekf.context.counts == {"old_corrections": 3}
    assert len(ekf.context.reports) == 1
    np.testing.assert_array_equal(ekf.prior(9900 * MS).pose, before.pose)
    ekf.on_correction(correction(7900 * MS, [0.79, 0.1, 0], prior_included=True))
    np.testing.assert_allclose(ekf.prior(9900 * MS).pose, [0.99, 0.1, 0], atol=1e-12)


@pytest.mark.parametrize("config", [{"buffer": 1.0}, {"buffer": 1e9, "buffer_size": 300}])
def test_buffers_are_bounded(make_ekf, config):
    ekf = make_ekf(**config)
    for i in range(5000):
        ekf.on_odometry(odometry(i * 10 * MS, [0.001 * i, 0, 0]))
        ekf.on_scan(scan(i * 10 * MS, i))
    assert len(ekf._history.entries) <= 600
    assert max(len(ekf._scans), len(ekf._stamps)) <= 4096
    np.testing.assert_allclose(ekf.prior(4999 * 10 * MS).pose, [4.999, 0, 0], atol=1e-9)


def test_numbers_that_are_none_are_counted_and_ignored(make_ekf):
    ekf = make_ekf()
    ekf.on_odometry(odometry(0, [0, 0, 0]))
    ekf.on_odometry(odometry(MS, [math.nan, 0, 0]))
    ekf.on_correction(correction(0, [math.inf, 0, 0], prior_included=True))
    ekf.on_correction(correction(0, [0, 0, 0], covariance=np.zeros((3, 3)), prior_included=True))
    ekf.on_correction(correction(0, [0, 0, 0], scan_information=-np.eye(3)))
    assert ekf.context.counts == {"invalid_odometry": 1, "invalid_corrections": 3}
    got = ekf.prior(0)
    assert np.isfinite(got.pose).all()


def test_a_correction_without_covariance_uses_the_configured_one(make_ekf):
    ekf = make_ekf(correction_sigma=(0.2, 0.1))
    ekf.on_odometry(odometry(0, [0, 0, 0]))
    ekf.on_correction(correction(0, [0, 0, 0], covariance=None, prior_included=True))
    np.testing.assert_allclose(np.diag(ekf.prior(0).covariance), [0.04, 0.04, 0.01])


# --- without odometry -------------------------------------------------------------------------------


def follow(ekf, poses, times):
    """Give every scan's true pose as its correction; return the error of each prior before it."""
    errors = []
    for i, (pose, time) in enumerate(zip(poses, times, strict=True)):
        ekf.on_scan(scan(time, i))
        errors.append(ekf.prior(time).pose - pose)
        ekf.on_correction(correction(time, pose, scan_id=i, prior_included=True))
    return np.array(errors)


def arc(n):
    pose, out = (0.0, 0.0, 0.0), []
    for _ in range(n):
        out.append(np.array(pose))
        pose = compose(pose, (0.05, 0.0, 0.03))
    return out


def test_steady_motion_is_predicted_whatever_the_stamps(make_ekf):
    rng = np.random.default_rng(2)
    bursts = np.maximum.accumulate(np.arange(60) * 200 * MS + rng.integers(-300, 300, 60) * MS)
    for times in (np.arange(60) * 200 * MS, bursts, np.zeros(60, int)):
        ekf = make_ekf()
        errors = follow(ekf, arc(60), times.tolist())
        assert np.abs(errors[2:]).max() < 1e-3 * 20  # the first motions are being learned
        assert np.abs(errors[15:]).max() < 1e-6
        assert not ekf.prior(int(times[-1])).weak


def test_steady_twist_comes_from_the_mean_period(make_ekf):
    ekf = make_ekf()
    follow(ekf, arc(60), [i * 200 * MS for i in range(60)])
    np.testing.assert_allclose(ekf.prior(59 * 200 * MS).twist, [0.25, 0.0, 0.15], atol=0.005)


def test_without_corrections_the_steady_motion_ends_and_is_weak(make_ekf):
    ekf = make_ekf(steady_scans=3)
    follow(ekf, arc(30), [i * 200 * MS for i in range(30)])
    poses = []
    for i in range(30, 40):
        ekf.on_scan(scan(i * 200 * MS, i))
        poses.append(ekf.prior(i * 200 * MS))
    assert [p.weak for p in poses[:2]] == [False, True]
    moved = [float(np.hypot(*d[:2])) for d in np.diff([p.pose for p in poses], axis=0)]
    assert moved[0] > 0.04
    assert moved[3:] == [0.0] * 6
    assert np.all(np.diff([p.covariance[0, 0] for p in poses]) > 0)


def test_scans_without_the_scan_stream_are_counted_by_their_corrections(make_ekf):
    ekf = make_ekf()
    errors = []
    for i, pose in enumerate(arc(40)):
        time = (i + 1) * 200 * MS
        errors.append(ekf.prior(time).pose - pose)
        ekf.on_correction(correction(time, pose, scan_id=i, prior_included=True))
    assert np.abs(errors[15:]).max() < 1e-6


def test_odometry_that_starts_late_takes_over(make_ekf):
    ekf = make_ekf()
    follow(ekf, arc(10), [i * 200 * MS for i in range(10)])
    last = arc(10)[-1]
    ekf.on_odometry(odometry(1850 * MS, [3.0, 3.0, 3.0]))
    np.testing.assert_allclose(ekf.prior(1850 * MS).pose, last, atol=1e-9)
    assert not ekf.prior(1850 * MS).weak
    ekf.on_odometry(odometry(1950 * MS, compose((3.0, 3.0, 3.0), (0.1, 0.0, 0.0))))
    np.testing.assert_allclose(ekf.prior(1950 * MS).pose, compose(last, (0.1, 0.0, 0.0)), atol=1e-9)


def test_config_refuses_nonsense():
    for bad in (
        {"gap": 0},
        {"twist_window": (0.5, 0.1)},
        {"start": (1, 2)},
        {"gaps": 1.0},
        {"floor": (0, 1)},
    ):
        with pytest.raises(ValueError, match="validation error"):
            EkfConfig(**bad)


def test_a_first_scan_from_before_the_first_odometry_corrects_the_pose_there(make_ekf):
    ekf = make_ekf()
    ekf.on_odometry(odometry(100 * MS, (0.0, 0.0, 0.0)))
    ekf.on_scan(scan(100 * MS, 0, stamp=40 * MS))
    ekf.on_correction(correction(100 * MS, (0.5, 0.2, 0.1), stamp=40 * MS, scan_id=0, prior_included=True))
    assert ekf.context.counts == {}
    assert ekf.context.reports == []
    np.testing.assert_array_equal(ekf.prior(100 * MS).pose, (0.5, 0.2, 0.1))
    ekf.on_odometry(odometry(200 * MS, (1.0, 0.0, 0.0)))
    np.testing.assert_allclose(ekf.prior(200 * MS).pose, compose((0.5, 0.2, 0.1), (1.0, 0.0, 0.0)), atol=1e-12)


def test_a_correction_long_before_the_first_odometry_is_too_old(make_ekf):
    ekf = make_ekf(buffer=10.0)
    ekf.on_odometry(odometry(100 * S, (0.0, 0.0, 0.0)))
    ekf.on_correction(correction(100 * S, (0.5, 0.2, 0.1), stamp=80 * S, prior_included=True))
    assert ekf.context.counts == {"old_corrections": 1}
