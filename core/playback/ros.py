"""ROS messages, as any decoder gives them (objects with the fields of the definition), to ours.

Definitions: sensor_msgs, nav_msgs, tf2_msgs, geometry_msgs of ROS 1 and 2; a stamp of 0 is the time of
arrival. Planar: z, roll and pitch are left out.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from knotwork.core.messages import Image, Imu, Message, Odometry, Scan, Transform, Twist
from knotwork.core.playback.frames import Frames, planar

Convert = Callable[[Any, int, Frames, int], Iterator[Message]]


def laser_scan(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """sensor_msgs/LaserScan."""
    yield make_scan(
        _stamp(m, arrival),
        number,
        m.ranges,
        float(m.angle_min),
        float(m.angle_increment),
        float(m.range_min),
        float(m.range_max),
        frames,
        str(m.header.frame_id),
        m.intensities,
        float(m.time_increment),
    )


def make_scan(
    stamp: int,
    number: int,
    ranges: Any,
    angle_min: float,
    increment: float,
    range_min: float,
    range_max: float,
    frames: Frames,
    frame: str,
    intensities: Any = (),
    time_increment: float = 0.0,
) -> Scan:
    """Return a scan after REP 117: too near and negative is invalid, `range_max` and more is no return."""
    if len(ranges) and not (np.isfinite(increment) and increment != 0.0 and np.isfinite(angle_min)):
        raise ValueError(f"beams from {angle_min} rad every {increment} rad")
    if not 0.0 <= range_min < range_max:
        raise ValueError(f"ranges from {range_min} to {range_max} m")
    values = np.array(ranges, np.float32)
    with np.errstate(invalid="ignore"):
        values[values >= range_max] = np.inf
        values[(values < range_min) | (values <= 0.0)] = np.nan
    strengths = np.array(intensities, np.float32)
    return Scan(
        stamp=stamp,
        scan_id=number,
        ranges=values,
        angle_min=angle_min,
        angle_increment=increment,
        range_min=range_min,
        range_max=range_max,
        mount=frames.mount(frame),
        time_increment=time_increment,
        intensities=strengths if len(strengths) == len(values) and len(values) else None,
        frame=frame,
    )


def odometry(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """nav_msgs/Odometry; its covariance is of the pose, not of the motion, and is left out."""
    pose = np.array(planar(m.pose.pose.position, m.pose.pose.orientation))
    if not np.isfinite(pose).all():
        raise ValueError("the pose is not finite")
    v, w = m.twist.twist.linear, m.twist.twist.angular
    yield Odometry(stamp=_stamp(m, arrival), pose=pose, twist=np.array((v.x, v.y, w.z), np.float64))


def transforms(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """tf2_msgs/TFMessage."""
    for each in m.transforms:
        pose = planar(each.transform.translation, each.transform.rotation)
        parent, child = str(each.header.frame_id), str(each.child_frame_id)
        frames.learn(parent, child, pose)
        yield Transform(
            stamp=_stamp(each, arrival), parent=frames.ours(parent), child=frames.ours(child), pose=np.array(pose)
        )


def imu(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """sensor_msgs/Imu; a first covariance of -1 says that there is no orientation."""
    q = m.orientation
    known = len(m.orientation_covariance) == 0 or m.orientation_covariance[0] != -1.0
    yield Imu(
        stamp=_stamp(m, arrival),
        angular_velocity=_vector(m.angular_velocity),
        linear_acceleration=_vector(m.linear_acceleration),
        orientation_wxyz=np.array((q.w, q.x, q.y, q.z), np.float64) if known else None,
    )


def compressed_image(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """sensor_msgs/CompressedImage; `format` may read "bgr8; jpeg compressed bgr8"."""
    yield make_image(_stamp(m, arrival), bytes(m.data), str(m.format), str(m.header.frame_id))


def make_image(stamp: int, data: bytes, form: str, frame: str) -> Image:
    """Return a compressed image; its size is read from the file's own head."""
    encoding = "png" if data[:4] == b"\x89PNG" else "jpeg" if data[:2] == b"\xff\xd8" else ""
    if not encoding:
        raise ValueError(f"an image of format {form!r} is neither JPEG nor PNG")
    from io import BytesIO

    from PIL import Image as Picture

    with Picture.open(BytesIO(data)) as picture:  # reads the head only
        width, height = picture.size
    return Image(stamp=stamp, data=data, encoding=encoding, width=width, height=height, frame=frame)


def image(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """sensor_msgs/Image; padding at the ends of rows is taken out."""
    rows = np.frombuffer(bytes(m.data), np.uint8).reshape(m.height, m.step) if m.height else np.empty((0, 0), np.uint8)
    width = m.step // m.width * m.width if m.width else 0
    yield Image(
        stamp=_stamp(m, arrival),
        data=rows[:, :width].tobytes(),
        encoding=str(m.encoding),
        width=int(m.width),
        height=int(m.height),
        frame=str(m.header.frame_id),
    )


def twist(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """geometry_msgs/Twist and TwistStamped."""
    inner = getattr(m, "twist", m)
    stamp = _stamp(m, arrival) if inner is not m else arrival
    yield Twist(stamp=stamp, vx=float(inner.linear.x), vy=float(inner.linear.y), wz=float(inner.angular.z))


# Name of the definition (ROS 2's form) to our type and the function.
ROS: dict[str, tuple[str, Convert]] = {
    "sensor_msgs/msg/LaserScan": ("scan", laser_scan),
    "nav_msgs/msg/Odometry": ("odometry", odometry),
    "tf2_msgs/msg/TFMessage": ("transform", transforms),
    "tf/msg/tfMessage": ("transform", transforms),
    "sensor_msgs/msg/Imu": ("imu", imu),
    "sensor_msgs/msg/CompressedImage": ("image", compressed_image),
    "sensor_msgs/msg/Image": ("image", image),
    "geometry_msgs/msg/Twist": ("twist", twist),
    "geometry_msgs/msg/TwistStamped": ("twist", twist),
}


def ros2_name(name: str) -> str:
    """Return `package/msg/Type` for `package/Type` and `package/msg/Type`."""
    package, _, kind = name.rpartition("/")
    return f"{package.removesuffix('/msg')}/msg/{kind}"


def _stamp(m: Any, arrival: int) -> int:
    time = m.header.stamp
    seconds = getattr(time, "sec", None)
    stamp = int(seconds if seconds is not None else time.secs) * 10**9
    stamp += int(time.nanosec if hasattr(time, "nanosec") else time.nsecs)
    return stamp or arrival


def _vector(v: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array((v.x, v.y, v.z), np.float64)
