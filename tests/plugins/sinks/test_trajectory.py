import math
import os
import subprocess
import sys
from decimal import Decimal

import numpy as np
import pytest
from evo.tools import file_interface
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from knotwork.core.errors import KnotworkError
from knotwork.core.messages import Pose, Trajectory
from knotwork.plugins.sinks.trajectory import TrajectoryConfig
from knotwork.plugins.sinks.trajectory.tum import line, seconds, stamp_of
from knotwork.plugins.sinks.trajectory.writer import TrajectoryWriter


class SinkContext:
    def __init__(self, out, **config):
        self.out = out
        self.config = TrajectoryConfig(**config)
        self.counts = {}
        self.reports = []

    def count(self, name, by=1):
        self.counts[name] = self.counts.get(name, 0) + by

    def report(self, level, text):
        self.reports.append((level, text))


def pose(scan_id, xyw, stamp=None, role="estimate", **more):
    stamp = 1_000_000_000 * scan_id if stamp is None else stamp
    return Pose(stamp=stamp, role=role, pose=np.array(xyw, float), scan_id=scan_id, **more)


def columns(path):
    return [[float(word) for word in text.split()] for text in path.read_text().splitlines()]


@given(st.integers(-(10**19), 10**19))
def test_stamps_are_exact(stamp):
    text = seconds(stamp)
    assert Decimal(text) * 10**9 == stamp
    assert len(text.split(".")[1]) in (6, 9)
    assert stamp_of(line(stamp, 1.0, 2.0, 3.0)) == stamp


def test_stamps_have_the_digits_of_the_log():
    assert seconds(976052857337284000) == "976052857.337284"
    assert seconds(976052857330000000) == "976052857.330000"
    assert seconds(1700000000000000001) == "1700000000.000000001"
    assert seconds(-1_500_000_000) == "-1.500000"


@given(st.floats(-20, 20))
def test_quaternion_is_the_yaw(yaw):
    quaternion = [float(word) for word in line(0, 0.0, 0.0, yaw).split()[4:]]
    assert Rotation.from_quat(quaternion).as_rotvec()[2] == pytest.approx(math.remainder(yaw, math.tau), abs=1e-8)
    assert quaternion[3] >= 0


def test_evo_reads_what_was_written(tmp_path):
    rng = np.random.default_rng(4)
    sink = TrajectoryWriter(SinkContext(tmp_path))
    poses = np.cumsum(rng.normal(0, 0.1, (50, 3)), axis=0)
    for i, p in enumerate(poses):
        sink.on_message("localizer.pose", pose(i, p, stamp=976052857337284000 + i * 200_000_000))
    sink.close()
    for name in ("trajectory.tum", "trajectory.online.tum"):
        read = file_interface.read_tum_trajectory_file(str(tmp_path / name))
        assert read.check()[0]
        np.testing.assert_allclose(read.positions_xyz[:, :2], poses[:, :2], atol=1e-6)
        np.testing.assert_allclose(read.timestamps, 976052857.337284 + 0.2 * np.arange(50), atol=1e-6)
        yaw = Rotation.from_quat(read.orientations_quat_wxyz[:, [1, 2, 3, 0]]).as_euler("zyx")[:, 0]
        np.testing.assert_allclose(np.exp(1j * yaw), np.exp(1j * poses[:, 2]), atol=1e-8)


def test_log_order_is_kept_where_stamps_run_backwards(tmp_path):
    sink = TrajectoryWriter(SinkContext(tmp_path))
    for i, stamp in enumerate((5, 3, 9, 9, 1)):
        sink.on_message("a.pose", pose(i, [i, 0, 0], stamp=stamp * 10**9))
    sink.on_message("a.pose", pose(-1, [77, 0, 0]))  # belongs to no scan
    sink.on_message("a.pose", pose(7, [88, 0, 0], role="prior"))
    sink.close()
    rows = columns(tmp_path / "trajectory.tum")
    assert [row[0] for row in rows] == [5, 3, 9, 9, 1]
    assert [row[1] for row in rows] == [0, 1, 2, 3, 4]


def test_a_lost_pose_keeps_its_line_and_one_without_numbers_is_counted(tmp_path):
    context = SinkContext(tmp_path)
    sink = TrajectoryWriter(context)
    sink.on_message("a.pose", pose(0, [0, 0, 0], lost=True))
    sink.on_message("a.pose", pose(1, [math.nan, 0, 0]))
    sink.close()
    assert len(columns(tmp_path / "trajectory.tum")) == 1
    assert context.counts == {"invalid_poses": 1}


def test_later_corrections_are_in_the_final_file_only(tmp_path):
    sink = TrajectoryWriter(SinkContext(tmp_path, name="path"))
    for i in range(4):
        sink.on_message("a.pose", pose(i, [i, 0, 0]))
    sink.on_message(
        "loop.trajectory",
        Trajectory(
            stamp=0,
            scan_ids=np.array([1, 2, 9]),
            stamps=np.array([1, 2, 9]) * 10**9,
            poses=np.array([[1.5, 0, 0], [2.5, 0, 0], [9, 9, 9]]),
            revision=1,
        ),
    )
    sink.on_message("a.pose", pose(4, [4, 0, 0], revision=1))
    sink.on_message("a.pose", pose(2, [0, 0, 0], revision=0))  # late, of a lower revision
    sink.on_message("a.pose", pose(3, [3.5, 0, 0], revision=2))
    sink.on_message(
        "loop.trajectory",
        Trajectory(
            stamp=0,
            scan_ids=np.array([3, 4]),
            stamps=np.array([3, 5]) * 10**9,
            poses=np.zeros((2, 3)),
            revision=1,
        ),
    )  # older than 3, and another sensor's 4
    sink.close()
    assert [row[1] for row in columns(tmp_path / "path.online.tum")] == [0, 1, 2, 3, 4]
    assert [row[1] for row in columns(tmp_path / "path.tum")] == [0, 1.5, 2.5, 3.5, 4]
    assert {p.name for p in tmp_path.iterdir()} == {"path.tum", "path.online.tum"}


NUMBER, REVISION = st.integers(0, 12), st.integers(0, 3)
ESTIMATE = st.tuples(st.just("pose"), NUMBER, REVISION)
CORRECTION = st.tuples(st.just("trajectory"), st.lists(NUMBER, max_size=5, unique=True), REVISION)


@given(st.lists(st.one_of(ESTIMATE, ESTIMATE, CORRECTION), max_size=40))
def test_any_order_of_estimates_and_corrections(tmp_path_factory, story):
    folder = tmp_path_factory.mktemp("paths")
    sink = TrajectoryWriter(SinkContext(folder))
    online, final = {}, {}  # scan -> what its line must say; scan -> (revision, what the corrected one must)
    for x, (kind, what, revision) in enumerate(story):
        if kind == "pose":
            sink.on_message("a.pose", pose(what, [x, 0, 0], revision=revision))
            online.setdefault(what, x)
            scans = [what]
        else:
            poses = np.tile([float(x), 0.0, 0.0], (len(what), 1))
            ids = np.array(what, np.int64)
            message = Trajectory(stamp=0, scan_ids=ids, stamps=ids * 10**9, poses=poses, revision=revision)
            sink.on_message("loop.trajectory", message)
            scans = [scan for scan in what if scan in online]
        for scan in scans:
            if scan not in final or revision >= final[scan][0]:
                final[scan] = revision, x
    sink.close()
    if online:
        rows = columns(folder / "trajectory.online.tum")
        assert [(row[0], row[1]) for row in rows] == list(online.items())
        rows = columns(folder / "trajectory.tum")
        assert [(row[0], row[1]) for row in rows] == [(scan, final[scan][1]) for scan in online]


def test_a_second_localizer_gets_its_own_files(tmp_path):
    sink = TrajectoryWriter(SinkContext(tmp_path))
    for i in range(3):
        sink.on_message("front.pose", pose(i, [i, 0, 0]))
        sink.on_message("rear.pose", pose(i, [-i, 0, 0]))
    sink.on_message("rear.pose", pose(2, [-5, 0, 0]))
    sink.close()
    assert [row[1] for row in columns(tmp_path / "trajectory.tum")] == [0, 1, 2]
    assert [row[1] for row in columns(tmp_path / "trajectory-rear-pose.tum")] == [0, -1, -5]
    assert [row[1] for row in columns(tmp_path / "trajectory-rear-pose.online.tum")] == [0, -1, -2]


def test_a_killed_run_keeps_its_lines(tmp_path):
    code = """
import os, signal, sys
from pathlib import Path
import numpy as np
from knotwork.core.messages import Pose
from knotwork.plugins.sinks.trajectory import TrajectoryConfig
from knotwork.plugins.sinks.trajectory.writer import TrajectoryWriter
class C: config = TrajectoryConfig(); out = Path(sys.argv[1])
sink = TrajectoryWriter(C())
for i in range(7):
    sink.on_message("a.pose", Pose(stamp=i, role="estimate", pose=np.zeros(3), scan_id=i))
os.kill(os.getpid(), signal.SIGKILL)
"""
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False, capture_output=True)
    assert done.returncode == -9
    assert len(columns(tmp_path / "trajectory.tum")) == 7
    assert len(columns(tmp_path / "trajectory.online.tum")) == 7


def test_no_pose_is_said(tmp_path):
    context = SinkContext(tmp_path)
    TrajectoryWriter(context).close()
    assert [level for level, _ in context.reports] == ["warning"]
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_one_clear_line(tmp_path):
    sink = TrajectoryWriter(SinkContext(tmp_path / "none"))
    with pytest.raises(KnotworkError, match=r"trajectory.online.tum: cannot write: No such file"):
        sink.on_message("a.pose", pose(0, [0, 0, 0]))


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full on this system")
def test_a_full_disk_is_one_clear_line(tmp_path):
    (tmp_path / "trajectory.online.tum").symlink_to("/dev/full")
    sink = TrajectoryWriter(SinkContext(tmp_path))
    with pytest.raises(KnotworkError, match=r"cannot write: No space left"):
        sink.on_message("a.pose", pose(0, [0, 0, 0]))
    sink.close()
