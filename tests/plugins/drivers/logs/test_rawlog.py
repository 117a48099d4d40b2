"""MRPT rawlogs, written here byte for byte as MRPT's published source writes them."""

import gzip
import math
import struct
from functools import partial

import numpy as np
import pytest
from ros_drive import played

from knotwork.core.errors import InputError
from knotwork.core.geometry import compose

UNIX = 116_444_736_000_000_000
START = 1_600_000_000 * 10**9


@pytest.fixture
def play(tmp_path):
    return partial(played, tmp_path)


def thing(name, version, body, namespace="mrpt::obs::"):
    full = (namespace + name).encode()
    return bytes([0x80 | len(full)]) + full + bytes([version]) + body + b"\x88"


def text(value):
    return struct.pack("<I", len(value)) + value.encode()


def time(stamp):
    return struct.pack("<Q", UNIX + stamp // 100)


def rotation(roll, pitch, yaw):
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return z @ y @ x


def pose3(version, at, turn, namespace):
    if version == 3:
        body = struct.pack("<3d", *at) + turn.astype("<f8").tobytes()
    elif version == 2:
        w = math.sqrt(max(0.0, 1 + np.trace(turn))) / 2
        if w > 1e-6:
            q = (
                w,
                (turn[2, 1] - turn[1, 2]) / 4 / w,
                (turn[0, 2] - turn[2, 0]) / 4 / w,
                (turn[1, 0] - turn[0, 1]) / 4 / w,
            )
        else:  # half a turn about an axis in the plane
            axis = np.sqrt(np.maximum(0, (np.diag(turn) + 1) / 2))
            q = (0.0, axis[0], math.copysign(axis[1], turn[0, 1]), axis[2])
        body = struct.pack("<7d", *at, *q)
    else:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn, at
        kind, name = ("<f4", "CMatrix") if version == 0 else ("<f8", "CMatrixD")
        body = thing(name, 0, struct.pack("<II", 4, 4) + matrix.astype(kind).tobytes(), namespace and "mrpt::math::")
    return thing("CPose3D", version, body, namespace and "mrpt::poses::")


def scan(version, stamp, ranges, valid, *, at=(0.1, 0.2, 0.3), turn=None, ccw=True, pose=3, label="FRONT", old=False):
    turn = np.eye(3) if turn is None else turn
    space = "" if old else "mrpt::obs::"
    body = struct.pack("<f?f", math.pi, ccw, 8.0) + pose3(pose, at, turn, space)
    if version < 6:
        body += thing("CMatrix", 0, struct.pack("<II", 6, 6) + bytes(144), space and "mrpt::math::")
    body += struct.pack("<I", len(ranges)) + np.asarray(ranges, "<f4").tobytes()
    if version >= 1:
        body += np.asarray(valid, np.uint8).tobytes()
    body += struct.pack("<f", 0.01) * (version >= 2) + time(stamp) * (version >= 3)
    body += struct.pack("<f", 0.004) * (version >= 4)
    if version >= 5:
        body += text(label) + struct.pack("<d", 0.0)
    if version >= 7:
        body += b"\1" + np.arange(len(ranges), dtype="<i4").tobytes()
    return thing("CObservation2DRangeScan", version, body, space)


def pose2(pose, version=1):
    return thing("CPose2D", version, struct.pack("<3d" if version else "<3f", *pose), "mrpt::poses::")


def odometry(version, stamp, pose, twist=None):
    body = pose2(pose) + text("ODOMETRY") + time(stamp)
    if version == 1:
        body += struct.pack("<?ii?ff", True, 3, 4, twist is not None, *((twist[0], twist[2]) if twist else (0, 0)))
    elif version == 2:
        body += struct.pack("<?", False) + struct.pack("<?", twist is not None)
        body += struct.pack("<3d", *twist) if twist else b""
    return thing("CObservationOdometry", version, body)


def motion(version, stamp, step):
    body = struct.pack("<i", 0) + pose2(step) + struct.pack("<i6f", 0, *[0.1] * 6)
    body += struct.pack("<i6f", 300, *[0.2] * 6) if version >= 5 else struct.pack("<i4f", 300, *[0.2] * 4)
    body += struct.pack("<?", False) + struct.pack("<?", False) if version == 7 else struct.pack("<?ff?ii", *[0] * 6)
    return thing("CActionRobotMovement2D", version, body + time(stamp) * (version >= 6))


RANGES = [1.0, 2.0, 8.0, 4.0, 0.0]
VALID = [1, 1, 0, 0, 1]
SEEN = np.array([1.0, 2.0, np.inf, np.nan, np.nan], np.float32)


@pytest.mark.parametrize("version", range(8))
@pytest.mark.parametrize("old", [False, True], ids=["namespaces", "plain"])
def test_scans_of_every_version(tmp_path, play, version, old):
    pose = min(version // 2, 3)
    path = tmp_path / "a.rawlog"
    stamps = [START + i * 10**8 for i in range(3)]
    ranges = RANGES if version else [1.0, 2.0, 8.0, np.nan, 0.0]
    path.write_bytes(b"".join(scan(version, s, ranges, VALID, pose=pose, old=old) for s in stamps))
    given, context = play("rawlog", path)
    scans = given["FRONT" if version >= 5 else "scan"]
    assert [m.stamp for m in scans] == (stamps if version >= 3 else [0, 0, 0])
    assert [m.scan_id for m in scans] == [0, 1, 2]
    np.testing.assert_array_equal(scans[0].ranges, SEEN)
    assert scans[0].mount == pytest.approx((0.1, 0.2, 0.0))
    assert scans[0].angle_increment == pytest.approx(math.pi / 4)
    assert context.reports == []


@pytest.mark.parametrize("ccw", [True, False])
@pytest.mark.parametrize("roll", [0.0, math.pi])
@pytest.mark.parametrize("pose", [1, 2, 3])
def test_a_beam_ends_where_it_ends_in_space(tmp_path, play, ccw, roll, pose):
    turn, at = rotation(roll, 0.0, 0.7), np.array([0.3, -0.2, 0.5])
    ranges = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    path = tmp_path / "a.rawlog"
    path.write_bytes(scan(6, START, ranges, np.ones(5), at=at, turn=turn, ccw=ccw, pose=pose))
    given, _ = play("rawlog", path)
    (found,) = given["FRONT"]
    angles = np.linspace(-math.pi / 2, math.pi / 2, 5) * (1 if ccw else -1)
    points = (turn @ np.array([ranges * np.cos(angles), ranges * np.sin(angles), 0 * ranges])).T + at
    ends = [
        compose(found.mount, (r * math.cos(a), r * math.sin(a), 0.0))[:2]
        for r, a in zip(found.ranges, found.angle_min + found.angle_increment * np.arange(5), strict=True)
    ]
    assert found.angle_increment > 0
    np.testing.assert_allclose(sorted(ends), sorted(points[:, :2].tolist()), atol=1e-6)


@pytest.mark.parametrize("version", [0, 1, 2])
def test_odometry(tmp_path, play, version):
    path = tmp_path / "a.rawlog"
    path.write_bytes(
        b"".join(odometry(version, START + i, (0.1 * i, 0.2, 0.3), (0.5, 0.0, 0.1) if i else None) for i in (0, 100))
    )
    given, _ = play("rawlog", path)
    poses = given["ODOMETRY"]
    np.testing.assert_allclose([m.pose for m in poses], [[0, 0.2, 0.3], [10, 0.2, 0.3]])
    assert poses[0].twist is None
    if version:
        np.testing.assert_allclose(poses[1].twist, [0.5, 0.0, 0.1], rtol=1e-6)


@pytest.mark.parametrize("version", [4, 5, 6, 7])
def test_actions_and_sensory_frames(tmp_path, play, version):
    step = (0.5, 0.0, 0.5)
    content = b""
    for i in range(4):
        stamp = START + i * 10**9
        content += thing("CActionCollection", 0, struct.pack("<I", 1) + motion(version, stamp, step))
        content += thing("CSensoryFrame", 2, struct.pack("<I", 1) + scan(7, stamp, RANGES, VALID))
    path = tmp_path / "a.rawlog"
    path.write_bytes(gzip.compress(content))
    given, context = play("rawlog", path)
    assert [port for port, _ in context.order] == ["odometry", "FRONT"] * 4
    pose = (0.0, 0.0, 0.0)
    for i, message in enumerate(given["odometry"]):
        pose = compose(pose, step)
        assert message.stamp == START + i * 10**9
        np.testing.assert_allclose(message.pose, pose, atol=1e-12)


def test_what_is_not_understood_is_passed_over_and_told(tmp_path, play):
    image = thing("CObservationImage", 4, bytes(range(256)) * 40)
    odd = thing("CObservation2DRangeScan", 99, bytes(50))
    content = b"".join(
        part for i in range(5) for part in (scan(7, START + i * 100, RANGES, VALID), image if i != 2 else odd)
    )
    path = tmp_path / "a.rawlog"
    path.write_bytes(content)
    given, context = play("rawlog", path)
    assert [m.stamp for m in given["FRONT"]] == [START + i * 100 for i in range(5)]
    (text_,) = (text for level, text in context.reports)
    assert "CObservationImage (4 objects)" in text_
    assert "CObservation2DRangeScan of version 99 (1 objects)" in text_


@pytest.mark.parametrize("packed", [False, True])
def test_a_cut_file_gives_what_came_before_the_cut(tmp_path, play, packed):
    rng = np.random.default_rng(1)
    content = b"".join(scan(7, START + i * 100, rng.uniform(1, 7, 100), np.ones(100)) for i in range(50))
    path = tmp_path / "a.rawlog"
    whole = gzip.compress(content) if packed else content
    path.write_bytes(whole[: len(whole) // 2 + 37])  # within an object
    given, context = play("rawlog", path)
    n = len(given["FRONT"])
    assert 20 < n < 30, n
    assert [m.stamp for m in given["FRONT"]] == [START + i * 100 for i in range(n)]
    assert context.reports
    assert len(context.reports) <= 2


@pytest.mark.parametrize("content", [b"", b"hello", b"\x1f\x8bgarbage"])
def test_what_is_no_rawlog(tmp_path, play, content):
    path = tmp_path / "a.rawlog"
    path.write_bytes(content)
    with pytest.raises(InputError, match="rawlog"):
        play("rawlog", path)
