"""Our messages as ROS 2's, and theirs as ours (REP-103, REP-105).

`frames` renames ours: ROS calls the robot's frame `base_link`. Planar poses stand at z = 0.
"""

import math
from collections.abc import Mapping

import numpy as np

from knotwork.core.messages import Grid, Message, Odometry, Scan, Transform, Twist
from knotwork.core.ros2.cdr import Reader, Writer

Frames = Mapping[str, str]

_SECOND = 1_000_000_000
_NEVER = 1e6  # variance of what a planar robot does not know

SCAN, ODOMETRY, GRID = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "nav_msgs/msg/OccupancyGrid"
TWIST, TF = "geometry_msgs/msg/Twist", "tf2_msgs/msg/TFMessage"


def encode(message: Message, frames: Frames) -> tuple[str, bytes] | None:
    """Return the ROS type and the CDR bytes of a message; None for a type that has no counterpart here."""
    out = Writer()
    if isinstance(message, Scan):
        _scan(out, message, frames)
        return SCAN, out.done()
    if isinstance(message, Odometry):
        _odometry(out, message, frames)
        return ODOMETRY, out.done()
    if isinstance(message, Grid):
        _grid(out, message, frames)
        return GRID, out.done()
    if isinstance(message, Twist):
        out.number("d", message.vx, message.vy, 0.0, 0.0, 0.0, message.wz)
        return TWIST, out.done()
    return None


def encode_tf(message: Message, frames: Frames) -> tuple[str, bytes] | None:
    """Return a TFMessage of what a message says of frames: odometry, a transform, a scanner's mount."""
    if isinstance(message, Transform):
        parent, child, pose = message.parent, message.child, message.pose.tolist()
    elif isinstance(message, Odometry):
        parent, child, pose = message.frame, message.child, message.pose.tolist()
    elif isinstance(message, Scan):
        parent, child, pose = "base", message.frame, list(message.mount)
    else:
        return None
    out = Writer()
    out.number("I", 1)
    _header(out, message.stamp, parent, frames)
    out.text(frames.get(child, child))
    x, y, yaw = pose
    out.number("d", x, y, 0.0)
    _turn(out, yaw)
    return TF, out.done()


def decode_scan(data: bytes, scan_id: int, mount: tuple[float, float, float]) -> Scan:
    """Return a LaserScan as ours; raises InputError when it is damaged.

    ROS drivers say "no return" in several ways (REP-117: inf; others: 0, or more than range_max); all become
    inf, but 0, which is invalid.
    """
    read = Reader(data)
    stamp, frame = _read_header(read)
    angle_min, _, increment, time_increment, _, range_min, range_max = read.numbers("f", 7)
    ranges = read.array("f4")
    intensities = read.array("f4")
    ranges = np.where(ranges >= range_max, np.float32(np.inf), ranges)
    ranges = np.where(ranges <= 0, np.float32(np.nan), ranges).astype(np.float32)
    return Scan(
        stamp=stamp,
        scan_id=scan_id,
        ranges=ranges,
        angle_min=angle_min,
        angle_increment=increment,
        range_min=range_min,
        range_max=range_max,
        mount=mount,
        time_increment=time_increment,
        intensities=intensities if len(intensities) == len(ranges) else None,
        frame=frame,
    )


def decode_odometry(data: bytes) -> Odometry:
    """Return an Odometry as ours, without its covariance: ROS states that of the pose, not of the motion."""
    read = Reader(data)
    stamp, _ = _read_header(read)
    read.text()
    x, y, _, qx, qy, qz, qw = read.numbers("d", 7)
    read.numbers("d", 36)
    vx, vy, _, _, _, wz = read.numbers("d", 6)
    yaw = math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
    return Odometry(stamp=stamp, pose=np.array([x, y, yaw]), twist=np.array([vx, vy, wz]))


def decode_twist(data: bytes, stamp: int) -> Twist:
    """Return a Twist as ours; it has no stamp of its own."""
    vx, vy, _, _, _, wz = Reader(data).numbers("d", 6)
    return Twist(stamp=stamp, vx=vx, vy=vy, wz=wz)


def _scan(out: Writer, message: Scan, frames: Frames) -> None:
    """Beams counter-clockwise, as ours are; ROS counts time from the first beam."""
    first = message.stamp + round(message.time_offset * _SECOND)
    _header(out, first, message.frame, frames)
    n = len(message.ranges)
    end = message.angle_min + max(n - 1, 0) * message.angle_increment
    turn = abs(message.time_increment) * n
    out.number("f", message.angle_min, end, message.angle_increment, message.time_increment, turn)
    out.number("f", message.range_min, message.range_max)
    out.array(message.ranges, "<f4")
    out.array(np.empty(0) if message.intensities is None else message.intensities, "<f4")


def _odometry(out: Writer, message: Odometry, frames: Frames) -> None:
    _header(out, message.stamp, message.frame, frames)
    out.text(frames.get(message.child, message.child))
    x, y, yaw = message.pose.tolist()
    out.number("d", x, y, 0.0)
    _turn(out, yaw)
    _covariance(out)
    vx, vy, wz = (0.0, 0.0, 0.0) if message.twist is None else message.twist.tolist()
    out.number("d", vx, vy, 0.0, 0.0, 0.0, wz)
    _covariance(out)


def _grid(out: Writer, message: Grid, frames: Frames) -> None:
    _header(out, message.stamp, message.frame, frames)
    _stamp(out, message.stamp)
    rows, columns = message.cells.shape
    out.number("f", message.resolution)
    out.number("I", columns, rows)
    x, y, yaw = message.origin
    out.number("d", x, y, 0.0)
    _turn(out, yaw)
    out.array(message.cells.reshape(-1), "i1")


def _covariance(out: Writer) -> None:
    """Write that nothing is known of z, roll and pitch; ours is that of a motion, which ROS has no place for."""
    out.number("d", *np.diag([0.0, 0.0, _NEVER, _NEVER, _NEVER, 0.0]).ravel().tolist())


def _header(out: Writer, stamp: int, frame: str, frames: Frames) -> None:
    _stamp(out, stamp)
    out.text(frames.get(frame, frame))


def _stamp(out: Writer, stamp: int) -> None:
    seconds, nanoseconds = divmod(stamp, _SECOND)
    out.number("i", min(max(seconds, -(2**31)), 2**31 - 1))
    out.number("I", nanoseconds)


def _turn(out: Writer, yaw: float) -> None:
    half = yaw / 2 if math.isfinite(yaw) else math.nan
    out.number("d", 0.0, 0.0, math.sin(half), math.cos(half))


def _read_header(read: Reader) -> tuple[int, str]:
    (seconds,) = read.numbers("i")
    (nanoseconds,) = read.numbers("I")
    return seconds * _SECOND + nanoseconds, read.text()
