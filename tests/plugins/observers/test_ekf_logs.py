"""The prior on recorded motion: real odometry, real stamps with their bursts and steps back."""

import lzma
from itertools import pairwise

import numpy as np
import pytest

from knotwork.core.geometry import relative
from knotwork.core.messages import Odometry, Pose, Scan

pytestmark = pytest.mark.data
SURE = 1e-5 * np.eye(3)


def carmen(path):
    """Robot odometry (n, 3) and stamps [ns] of a CARMEN log's FLASER lines."""
    poses, stamps = [], []
    with lzma.open(path, "rt") as lines:
        for line in lines:
            if line.startswith("FLASER"):
                words = line.split()
                n = int(words[1])
                poses.append([float(w) for w in words[n + 5 : n + 8]])
                stamps.append(round(float(words[n + 8]) * 1e6) * 1000)
    return np.array(poses), np.array(stamps)


def gazebo(path):
    """True poses (n, 3) of the simulator, at the sensor's 5 Hz."""
    with lzma.open(path, "rt") as lines:
        poses = np.array([[float(w) for w in line.split(maxsplit=3)[:3]] for line in lines])
    return poses, np.arange(len(poses)) * 200_000_000


def run(ekf, poses, stamps, with_odometry):
    """Play a log with every pose given as its scan's correction; return error and weakness of each prior."""
    errors, weak = [], []
    origin = poses[0]
    times = np.maximum.accumulate(stamps).tolist()
    for i, (pose, stamp, time) in enumerate(zip(poses, stamps.tolist(), times, strict=True)):
        if with_odometry:
            ekf.on_odometry(Odometry(stamp=stamp, pose=pose).sealed(time, 0))
        ekf.on_scan(
            Scan(
                stamp=stamp,
                scan_id=i,
                ranges=np.empty(0, np.float32),
                angle_min=0.0,
                angle_increment=0.1,
                range_min=0.0,
                range_max=9.0,
            ).sealed(time, 0)
        )
        truth = relative(origin, pose)
        prior = ekf.prior(time)
        errors.append(relative(truth, prior.pose.tolist()))
        weak.append(prior.weak)
        ekf.on_correction(
            Pose(
                stamp=stamp,
                role="estimate",
                pose=np.array(truth),
                covariance=SURE,
                scan_id=i,
                prior_included=True,
            ).sealed(time, 0)
        )
    return np.array(errors), np.array(weak)


@pytest.mark.parametrize("log", ["intel", "fr079", "aces"])
def test_odometry_is_followed_whatever_the_stamps(make_ekf, observer_data, log):
    poses, stamps = carmen(observer_data / log / f"{log}.clf.xz")
    ekf = make_ekf()
    errors, weak = run(ekf, poses, stamps, with_odometry=True)
    assert np.abs(errors).max() < 1e-9
    # Weak only where the robot really moved far between two scans, not for the gaps of bursts of stamps.
    steps = np.array([relative(a, b) for a, b in pairwise(poses)])
    assert weak.sum() <= (np.hypot(steps[:, 0], steps[:, 1]) > 0.3).sum() + (np.abs(steps[:, 2]) > 0.3).sum()
    assert "refused_corrections" not in ekf.context.counts


@pytest.mark.parametrize(
    ("log", "centimetres", "degrees"),
    [("intel", 3.0, 2.3), ("fr079", 6.0, 5.0), ("turtlebot3_world", 3.0, 2.0)],
)
def test_without_odometry_the_last_motion_is_a_start_for_a_scan_matcher(
    make_ekf, observer_data, log, centimetres, degrees
):
    if log == "turtlebot3_world":
        poses, stamps = gazebo(observer_data / log / "turtle_world.txt.xz")
    else:
        poses, stamps = carmen(observer_data / log / f"{log}.clf.xz")
    errors, weak = run(make_ekf(), poses, stamps, with_odometry=False)
    moved = np.array([relative(a, b) for a, b in pairwise(poses)])
    distance = np.hypot(errors[:, 0], errors[:, 1])
    assert np.percentile(distance, 95) < centimetres / 100
    assert np.degrees(np.percentile(np.abs(errors[:, 2]), 95)) < degrees
    # Better than to expect the robot where the last scan was.
    assert np.square(distance).sum() < 0.3 * np.square(moved[:, :2]).sum()
    assert np.square(errors[:, 2]).sum() < 0.4 * np.square(moved[:, 2]).sum()
    assert weak.mean() < 0.01
