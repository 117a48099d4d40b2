import lzma
import math

import numpy as np
import pytest

from knotwork.core.evaluation.relations import read_relations, score_relations
from knotwork.core.evaluation.tum import StampedPoses, read_tum, write_tum
from knotwork.core.stamps import format_seconds
from knotwork.plugins.drivers.carmen import CarmenConfig
from knotwork.plugins.drivers.carmen.driver import CarmenDriver
from knotwork.plugins.drivers.gazebo_text import GazeboTextConfig
from knotwork.plugins.drivers.gazebo_text.driver import GazeboTextDriver
from knotwork.plugins.drivers.minesrover import MinesroverConfig
from knotwork.plugins.drivers.minesrover.driver import MinesroverDriver

pytestmark = pytest.mark.data

# Published with the data: scans, beams, duration [s], odometry path [m], turning [rad], backward stamps,
# share of no return, smallest range, mount.
LOGS = {
    "intel": (13631, 180, 2691.3, 508.4, 342, 658, 0.028, 0.20, (0.0, 0.0, 0.0)),
    "fr079": (4934, 360, 1061.3, 391.6, 264, 0, 0.021, 0.12, (-0.04, 0.0, 0.0)),
    "aces": (7374, 180, 1365.5, 325.2, 159, 0, None, 0.31, (0.0, 0.0, 0.0)),
}


@pytest.fixture(scope="module")
def carmen(run_driver, log_data):
    read = {}

    def get(name):
        if name not in read:
            path = log_data / name / f"{name}.clf.xz"
            read[name] = run_driver(CarmenDriver, CarmenConfig(path=str(path)))
        return read[name]

    return get


def split(events):
    odometry = [message for port, message in events if port == "odometry"]
    scans = [message for port, message in events if port == "scan"]
    return odometry, scans


def path_and_turning(poses):
    steps = np.diff(poses, axis=0)
    return np.hypot(steps[:, 0], steps[:, 1]).sum(), np.abs(np.angle(np.exp(1j * steps[:, 2]))).sum()


@pytest.mark.parametrize("name", LOGS)
def test_carmen_logs_are_what_their_description_says(carmen, name):
    n, beams, duration, path, turning, backward, share, smallest, mount = LOGS[name]
    events, context = carmen(name)
    assert context.reports == []
    assert context.counts == {}
    assert [port for port, _ in events] == ["odometry", "scan"] * n
    odometry, scans = split(events)
    assert [message.scan_id for message in scans] == list(range(n))
    assert [message.stamp for message in scans] == [message.stamp for message in odometry]
    assert {message.mount for message in scans} == {mount}
    stamps = np.array([message.stamp for message in scans])
    assert (np.ptp(stamps) * 1e-9).round(1) == duration
    assert (np.diff(stamps) < 0).sum() == backward
    walked, turned = path_and_turning(np.array([message.pose for message in odometry]))
    assert round(walked, 1) == path
    assert abs(turned - turning) < 1
    ranges = np.array([message.ranges for message in scans])
    assert ranges.shape == (n, beams)
    assert np.nanmin(ranges) == np.float32(smallest)
    assert not np.isnan(ranges).any()
    if share is not None:
        assert round(float(np.isinf(ranges).mean()), 3) == share


@pytest.mark.parametrize("name", ["intel", "fr079"])
def test_stamps_have_the_digits_of_the_log(carmen, log_data, name, tmp_path):
    odometry, _ = split(carmen(name)[0])
    stamps = [message.stamp for message in odometry]
    with lzma.open(log_data / name / f"{name}.stamps.txt.xz", "rt") as file:
        table = [line.split()[1] for line in file if not line.startswith("#")]
    assert [format_seconds(stamp) for stamp in stamps] == table
    write_tum(tmp_path / "t.tum", stamps, [message.pose for message in odometry])
    lines = (tmp_path / "t.tum").read_text().splitlines()
    assert [line.split()[0] for line in lines] == table
    again = read_tum(tmp_path / "t.tum")
    assert again.stamps.tolist() == stamps
    assert np.allclose(again.poses, [message.pose for message in odometry], atol=1e-6)


# Baselines published with the data: relations, mean and standard deviation of |t|, |t|^2, |r|, |r|^2.
BASELINES = {
    ("intel", "odometry", "all"): (2984, "7.371 14.350 260.3 781.4 39.15 53.79 4427 7487"),
    ("intel", "gmapping", "all"): (2984, "0.0423 0.0363 0.00311 0.00547 1.903 1.645 6.33 11.7"),
    ("intel", "odometry", "short"): (1770, "0.0236 0.0229 0.00108 0.00219 1.484 1.214 3.68 6.79"),
    ("intel", "gmapping", "short"): (1770, "0.0324 0.0330 0.00214 0.00472 1.786 1.614 5.80 12.0"),
    ("intel", "gmapping", "long"): (1210, "0.0565 0.0359 0.00449 0.00600 2.069 1.669 7.07 11.0"),
    ("fr079", "odometry", "all"): (1685, "6.504 13.664 229.0 653.2 30.30 45.52 2990 6140"),
    ("fr079", "gmapping", "all"): (1685, "0.0458 0.0320 0.00312 0.00478 0.712 0.691 0.983 2.27"),
    ("fr079", "odometry", "short"): (987, "0.0585 0.1129 0.0162 0.0926 2.403 2.559 12.3 32.4"),
    ("fr079", "gmapping", "short"): (987, "0.0384 0.0249 0.00209 0.00304 0.693 0.665 0.923 2.10"),
    ("fr079", "gmapping", "long"): (577, "0.0578 0.0385 0.00483 0.00650 0.691 0.704 0.973 2.52"),
}
COLUMNS = [
    f"{part}_{what}_{spread}_{unit}{power}"
    for part, unit in (("trans", "m"), ("rot", "deg"))
    for what, power in (("abs", ""), ("sq", "2"))
    for spread in ("mean", "std")
]


@pytest.mark.parametrize("row", BASELINES, ids="-".join)
def test_the_evaluator_reproduces_the_published_baselines(carmen, log_data, row):
    name, path, subset = row
    used, figures = BASELINES[row]
    if path == "odometry":
        odometry, _ = split(carmen(name)[0])
        poses = np.array([message.pose for message in odometry])
        trajectory = StampedPoses(np.array([message.stamp for message in odometry]), poses)
    else:
        trajectory = read_tum(log_data / name / f"{name}.gmapping.txt.xz")
    score = score_relations(trajectory, read_relations(log_data / name / f"{name}.relations.xz"))
    part = score if subset == "all" else score[subset]
    assert (part["used"], part["missed"]) == (used, 0)
    for column, shown in zip(COLUMNS, figures.split(), strict=True):
        unit = 10.0 ** -len(shown.partition(".")[2])
        # 0.53, not 0.5: two of the 80 figures were rounded twice (260.248 to 260.25 to 260.3).
        assert part[column] == pytest.approx(float(shown), abs=0.53 * unit), column


def test_a_good_path_scores_worse_as_sensor_poses(log_data):
    # 0.058 m as sensor poses, 0.046 m as robot poses, as published with the data.
    robot = read_tum(log_data / "fr079" / "fr079.gmapping.txt.xz")
    relations = read_relations(log_data / "fr079" / "fr079.relations.xz")
    x, y, yaw = robot.poses.T
    sensor = np.stack((x - 0.04 * np.cos(yaw), y - 0.04 * np.sin(yaw), yaw), axis=1)
    assert score_relations(robot, relations)["trans_abs_mean_m"] == pytest.approx(0.046, abs=5e-4)
    score = score_relations(StampedPoses(robot.stamps, sensor), relations)
    assert score["trans_abs_mean_m"] == pytest.approx(0.058, abs=5e-4)


def test_turtlebot_returns_lie_on_the_pillars_of_its_world(run_driver, log_data):
    path = log_data / "turtlebot3_world" / "turtle_world.txt.xz"
    events, context = run_driver(GazeboTextDriver, GazeboTextConfig(path=str(path)))
    assert context.reports == []
    assert [port for port, _ in events] == ["truth", "scan"] * 618
    truth = [message for port, message in events if port == "truth"]
    _, scans = split(events)
    assert {message.role for message in truth} == {"truth"}
    assert [message.scan_id for message in truth] == [message.scan_id for message in scans] == list(range(618))
    assert [message.stamp for message in scans] == [i * 200_000_000 for i in range(618)]
    walked, turned = path_and_turning(np.array([message.pose for message in truth]))
    assert (round(walked, 1), round(turned)) == (5.9, 8)
    ranges = np.array([message.ranges for message in scans])
    assert round(float(np.isinf(ranges).mean()), 2) == 0.06

    grid = np.stack(np.meshgrid((-1.1, 0.0, 1.1), (-1.1, 0.0, 1.1)), axis=-1).reshape(-1, 2)
    errors = []
    for pose, scan in zip(truth, scans, strict=True):
        x, y, yaw = pose.pose
        angles = yaw + scan.mount[2] + scan.angle_min + scan.angle_increment * np.arange(scan.ranges.size)
        seen = np.isfinite(scan.ranges)
        points = np.array((x, y)) + scan.mount[0] * np.array((math.cos(yaw), math.sin(yaw)))
        points = points + scan.ranges[seen, None] * np.stack((np.cos(angles), np.sin(angles)), axis=1)[seen]
        distance = np.hypot(*(points[:, None, :] - grid).transpose(2, 0, 1)).min(axis=1) - 0.15
        errors.append(np.abs(distance[np.abs(distance) < 0.08]))
    assert np.median(np.concatenate(errors)) == pytest.approx(0.005, abs=1e-3)


def test_turtlebot_truth_as_odometry(run_driver, log_data):
    path = log_data / "turtlebot3_world" / "turtle_world.txt.xz"
    events, _ = run_driver(GazeboTextDriver, GazeboTextConfig(path=str(path), odometry="truth", limit=20))
    assert [port for port, _ in events] == ["truth", "odometry", "scan"] * 20
    for (_, truth), (_, odometry) in zip(events[::3], events[1::3], strict=True):
        assert np.array_equal(truth.pose, odometry.pose)
        assert truth.stamp == odometry.stamp


@pytest.mark.parametrize(
    ("name", "n", "duration", "path", "zeros"),
    [("exp1", 756, 74.6, 46.0, 0.53), ("exp2", 641, 63.2, 44.5, 0.55)],
)
def test_rover_logs_are_what_their_description_says(run_driver, log_data, name, n, duration, path, zeros):
    file = str(log_data / "minesrover" / f"{name}.dat.xz")
    events, context = run_driver(MinesroverDriver, MinesroverConfig(path=file, margin=0, range_max=6.0))
    assert context.reports == []
    assert [port for port, _ in events] == ["odometry", "scan"] * n
    odometry, scans = split(events)
    stamps = np.array([message.stamp for message in scans])
    assert (np.ptp(stamps) * 1e-9).round(1) == duration
    assert path_and_turning(np.array([message.pose for message in odometry]))[0].round(1) == path
    assert not any(message.discontinuity for message in odometry)
    ranges = np.array([message.ranges for message in scans])
    assert ranges.shape == (n, 682)
    assert np.isinf(ranges).mean() == pytest.approx(zeros, abs=0.006)
    assert np.max(ranges[np.isfinite(ranges)]) < 5.7
    assert scans[0].angle_min + 681 * scans[0].angle_increment == pytest.approx(math.radians(120.0))


def test_the_rover_comes_as_much_nearer_to_walls_as_its_wheels_say(run_driver, log_data):
    # Straight drives of more than 0.3 m: the range ahead shrinks by what the encoders measured.
    file = str(log_data / "minesrover" / "exp1.dat.xz")
    odometry, scans = split(run_driver(MinesroverDriver, MinesroverConfig(path=file))[0])
    ahead = slice(331, 351)
    shares = []
    for i in range(len(scans) - 10):
        x, y, yaw = odometry[i + 10].pose - odometry[i].pose
        near, far = scans[i + 10].ranges[ahead], scans[i].ranges[ahead]
        near, far = near[np.isfinite(near)], far[np.isfinite(far)]
        if abs(yaw) < 0.03 and math.hypot(x, y) > 0.3 and min(near.size, far.size) > 10:
            shares.append((np.median(far) - np.median(near)) / math.hypot(x, y))
    assert len(shares) > 20
    assert np.median(shares) == pytest.approx(1.0, abs=0.05)
