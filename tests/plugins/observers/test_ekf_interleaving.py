"""A correction delayed by T, in any interleaving, gives what the on-time one gives."""

import math
from itertools import cycle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm, logm

from knotwork.core.messages import Odometry, Pose, Scan

MS = 1_000_000
RANGES = np.ones(3, np.float32)


def odometry(time, pose, **more):
    return Odometry(stamp=time, pose=np.array(pose, float), **more).sealed(time, 0)


def scan(time, scan_id, stamp=None):
    return Scan(
        stamp=time if stamp is None else stamp,
        scan_id=scan_id,
        ranges=RANGES,
        angle_min=0.0,
        angle_increment=0.1,
        range_min=0.1,
        range_max=10.0,
    ).sealed(time, 0)


def correction(time, pose, scan_id=-1, stamp=None, **more):
    stamp = time if stamp is None else stamp
    return Pose(stamp=stamp, role="estimate", pose=np.array(pose, float), scan_id=scan_id, **more).sealed(time, 0)


STEP = st.tuples(
    st.integers(0, 150),  # ms since the last event; 0: the same time
    st.sampled_from(["odometry", "odometry", "scan"]),
    st.sampled_from(["replace", "covariance", "corridor", "wild", "lost"]),
    st.integers(0, 12),  # events by which the correction is late
    st.booleans(),  # a discontinuity, a covariance of its own
    st.integers(0, 1000),
)


def events(steps, with_odometry):
    """Messages in order of measurement, and for each correction by how many messages it may be late."""
    time, pose, out = 0, (0.0, 0.0, 0.0), []
    truth = np.zeros(3)
    if with_odometry:
        out.append((odometry(0, pose), 0))
    for i, (later, kind, form, late, special, seed) in enumerate(steps):
        rng = np.random.default_rng(seed)
        time += later * MS
        if kind == "odometry" and with_odometry:
            pose = tuple(np.add(pose, rng.normal(0, [0.05, 0.05, 0.1])))
            more = {}
            if special:
                more = {"discontinuity": True} if seed % 4 == 0 else {"covariance": np.diag([2e-4, 1e-4, 3e-4])}
            out.append((odometry(time, pose, **more), 0))
        elif kind == "scan":
            truth = np.array(pose) + rng.normal(0, 0.02, 3) if with_odometry else truth + rng.normal(0, 0.05, 3)
            # Stamps run backwards and are shared; the scan's number tells them apart.
            stamp = time - (seed % 3) * 40 * MS
            out.append((scan(time, i, stamp), 0))
            covariance = np.diag(rng.uniform(1e-5, 1e-3, 3))
            more = {"covariance": covariance, "prior_included": form == "replace", "lost": form == "lost"}
            if form == "corridor":
                more |= {"scan_pose": truth, "scan_information": np.diag([0.0, 1e4, 1e4])}
            where = truth + 3.0 if form == "wild" else truth
            out.append((correction(time, where, i, stamp, **more), late))
    return out


def deliver(ekf, messages):
    for message in messages:
        if isinstance(message, Odometry):
            ekf.on_odometry(message)
        elif isinstance(message, Scan):
            ekf.on_scan(message)
        else:
            ekf.on_correction(message)


def delayed(with_lateness):
    """Order of arrival: everything keeps its place but for corrections, which slip back by their lateness."""
    keyed = [(i + late + 0.5 * (late > 0), i, message) for i, (message, late) in enumerate(with_lateness)]
    return [message for _, _, message in sorted(keyed, key=lambda item: item[:2])]


def answers(ekf, times):
    return [(p.pose, p.covariance, p.twist, p.weak) for p in map(ekf.prior, times)]


def assert_equal_answers(a, b):
    for (pose_a, cov_a, twist_a, weak_a), (pose_b, cov_b, twist_b, weak_b) in zip(a, b, strict=True):
        np.testing.assert_allclose(pose_a, pose_b, rtol=0, atol=1e-12)
        np.testing.assert_allclose(cov_a, cov_b, rtol=0, atol=1e-12)
        np.testing.assert_allclose(twist_a, twist_b, rtol=0, atol=1e-12)
        assert weak_a == weak_b


@pytest.mark.parametrize("with_odometry", [True, False])
@given(steps=st.lists(STEP, max_size=40))
@settings(max_examples=150, deadline=None)
def test_late_is_as_good_as_on_time(make_ekf, with_odometry, steps):
    messages = events(steps, with_odometry)
    on_time, late = make_ekf(gate_patience=2), make_ekf(gate_patience=2)
    deliver(on_time, [m for m, _ in messages])
    deliver(late, delayed(messages))
    end = messages[-1][0].time if messages else 0
    times = [*range(0, end + 400 * MS, 37 * MS), *(m.time for m, _ in messages)]
    assert_equal_answers(answers(on_time, times), answers(late, times))
    assert late.context.counts.get("lost_corrections", 0) == on_time.context.counts.get("lost_corrections", 0)


@given(steps=st.lists(STEP, min_size=1, max_size=30))
@settings(max_examples=50, deadline=None)
def test_without_the_scan_stream_the_time_places_a_correction(make_ekf, steps):
    # Times must then be distinct: nothing else says before or after which odometry the scan was taken.
    steps = [(later + 1, *rest) for later, *rest in steps]
    messages = [(m, late) for m, late in events(steps, True) if not isinstance(m, Scan)]
    on_time, late = make_ekf(), make_ekf()
    deliver(on_time, [m for m, _ in messages])
    deliver(late, delayed(messages))
    end = messages[-1][0].time
    times = range(0, end + 400 * MS, 37 * MS)
    assert_equal_answers(answers(on_time, times), answers(late, times))


@given(steps=st.lists(STEP, min_size=1, max_size=30), held=st.lists(st.integers(0, 6), min_size=1, max_size=20))
@settings(max_examples=100, deadline=None)
def test_odometry_that_a_busy_host_hands_on_late_counts_from_its_stamp(make_ekf, steps, held):
    # Odometry keeps its own order, but scans taken later, and their corrections, overtake it.
    steps = [(later + 1, kind, form, 0, False, 3 * seed) for later, kind, form, _, _, seed in steps]
    messages = [m for m, _ in events(steps, True)]
    late, waiting = [messages[0]], []
    for message, events_left in zip(messages[1:], cycle(held), strict=False):
        if isinstance(message, Odometry):
            waiting.append([message, events_left])
        else:
            late.append(message)
        while waiting and waiting[0][1] <= 0:
            late.append(waiting.pop(0)[0])
        for each in waiting:
            each[1] -= 1
    late += [m for m, _ in waiting]
    now, arrived = 0, []
    for message in late:
        now = max(now, message.time)
        arrived.append(message.sealed(now, 0) if isinstance(message, Odometry) else message)
    a, b = make_ekf(), make_ekf()
    deliver(a, messages)
    deliver(b, arrived)
    end = messages[-1].time
    times = [*range(0, end + 400 * MS, 37 * MS), *(m.time for m in messages)]
    assert_equal_answers(answers(a, times), answers(b, times))


def test_odometry_of_another_clock_counts_from_its_arrival(make_ekf):
    ekf, uptime = make_ekf(), 3600 * 1000 * MS
    for k in range(20):
        pose = np.array([0.02 * k, 0.0, 0.0])
        ekf.on_odometry(Odometry(stamp=k * 100 * MS, pose=pose).sealed(uptime + k * 100 * MS, k))
    np.testing.assert_allclose(ekf.prior(uptime + 1050 * MS).pose, [0.21, 0.0, 0.0], atol=1e-12)


def matrix(pose):
    x, y, yaw = pose
    return np.array([[math.cos(yaw), -math.sin(yaw), x], [math.sin(yaw), math.cos(yaw), y], [0, 0, 1]])


def vector(m):
    return np.array([m[0, 2], m[1, 2], math.atan2(m[1, 0], m[0, 0])])


def test_late_corrections_between_odometry_agree_with_a_plain_filter(make_ekf):
    """The reference sorts everything, interpolates with matrix logarithms and filters in one pass."""
    rng = np.random.default_rng(5)
    config = {"start_sigma": (0.1, 0.1), "floor": (0.02, 0.03), "gate": 0.0}
    ekf = make_ekf(**config)
    c = ekf.context.config
    knots = [(i * 100 * MS, matrix((0.05 * i, 0.02 * math.sin(i), 0.1 * i))) for i in range(31)]
    fixes = []
    for k in range(12):
        time = (180 + 230 * k) * MS
        r = np.diag(rng.uniform(1e-4, 1e-3, 3))
        fixes.append((time, vector(knots[round(time / 100 / MS)][1]) + rng.normal(0, 0.03, 3), r))

    pose, p = np.zeros(3), np.diag([0.01, 0.01, 0.01])
    queue = sorted([(t, None, m) for t, m in knots] + [(t, z, r) for t, z, r in fixes], key=lambda e: e[0])
    at, last = 0, knots[0][1]
    off = np.zeros(2)  # sigma of where the last step began: how far an interpolated place may be off
    for time, z, what in queue:
        begun = off
        if z is None:
            odom, off = what, np.zeros(2)
        else:
            i = time // (100 * MS)
            whole = np.linalg.inv(knots[i][1]) @ knots[i + 1][1]
            share = time / (100 * MS) - i
            odom = knots[i][1] @ expm(np.real(logm(whole)) * share)
            change = np.minimum(
                [1.5 * 0.1**2 / 4, 6.0 * 0.1**2 / 4], [math.hypot(*whole[:2, 2]), abs(vector(whole)[2])]
            )
            off = 2.0 * share * (1.0 - share) * change
        motion = np.linalg.inv(last) @ odom
        d, turn = math.hypot(*motion[:2, 2]), abs(vector(motion)[2])
        dt = (time - at) * 1e-9
        t = c.translation_per_metre**2 * d + c.translation_per_radian**2 * turn + c.floor[0] ** 2 * dt
        r = c.rotation_per_metre**2 * d + c.rotation_per_radian**2 * turn + c.floor[1] ** 2 * dt
        t, r = (t, r) + off**2 + begun**2
        new = vector(matrix(pose) @ motion)
        jacobian = np.eye(3)
        jacobian[:2, 2] = [-(new - pose)[1], (new - pose)[0]]
        pose, p, at, last = new, jacobian @ p @ jacobian.T + np.diag([t, t, r]), time, odom
        if z is not None:
            gain = p @ np.linalg.inv(p + what)
            e = z - pose
            e[2] = math.remainder(e[2], math.tau)
            pose, p = pose + gain @ e, (np.eye(3) - gain) @ p

    for time, m in knots:
        ekf.on_odometry(odometry(time, vector(m)))
    for i in rng.permutation(len(fixes)):
        time, z, r = fixes[i]
        ekf.on_correction(correction(time, z, covariance=r))
    got = ekf.prior(knots[-1][0])
    e = got.pose - pose
    e[2] = math.remainder(e[2], math.tau)
    np.testing.assert_allclose(e, 0, atol=1e-11)
    np.testing.assert_allclose(got.covariance, p, atol=1e-12)


def test_linear_case_agrees_with_batch_least_squares(make_ekf):
    """Pure translation at yaw 0: the filter's end is the least-squares solution of all poses together."""
    rng = np.random.default_rng(3)
    n = 15
    ekf = make_ekf(start_sigma=(0.2, 1e-9), gate=0.0)
    q, r = np.diag([4e-4, 1e-4]), np.diag([1e-3, 2e-3])
    steps = rng.normal(0, 0.1, (n - 1, 2))
    odom = np.vstack([[0, 0], np.cumsum(steps, axis=0)])
    seen = odom + rng.normal(0, 0.03, (n, 2))
    tiny = 1e-18
    for i in range(n):
        cov = np.diag([4e-4, 1e-4, tiny]) if i else None
        ekf.on_odometry(odometry(i * MS, [*odom[i], 0.0], covariance=cov))
    for i in reversed(range(n)):
        ekf.on_correction(correction(i * MS, [*seen[i], 0.0], covariance=np.diag([1e-3, 2e-3, 1.0])))

    rows, rhs = [], []
    for i in range(n):
        for k in range(2):
            for cells, value, sigma in (
                ([(i, 1.0)], seen[i, k], math.sqrt(r[k, k])),
                (
                    [(i, 1.0), (i - 1, -1.0)] if i else [(0, 1.0)],
                    steps[i - 1, k] if i else 0.0,
                    math.sqrt(q[k, k]) if i else 0.2,
                ),
            ):
                row = np.zeros(2 * n)
                for j, v in cells:
                    row[2 * j + k] = v / sigma
                rows.append(row)
                rhs.append(value / sigma)
    a = np.array(rows)
    solution = np.linalg.lstsq(a, np.array(rhs), rcond=None)[0]
    got = ekf.prior((n - 1) * MS)
    np.testing.assert_allclose(got.pose[:2], solution[-2:], atol=1e-9)
    np.testing.assert_allclose(got.covariance[:2, :2], np.linalg.inv(a.T @ a)[-2:, -2:], atol=1e-9)
