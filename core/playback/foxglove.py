"""Messages under Foxglove's schemas, protobuf or JSON, to ours."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from typing import Any

import msgspec
import numpy as np
from google.protobuf.json_format import ParseDict, ParseError
from google.protobuf.message import DecodeError
from google.protobuf.timestamp_pb2 import Timestamp

from knotwork.core.geometry import compose
from knotwork.core.messages import Image, Message, Odometry, Pose, Transform
from knotwork.core.playback.frames import Frames, planar
from knotwork.core.playback.ros import Convert, make_image, make_scan

_SECOND = 1_000_000_000
_RANGE_MAX = 1000.0  # m; the schema does not say what the sensor can measure


def laser_scan(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """foxglove.LaserScan: the sensor's pose is in the message."""
    n = len(m.ranges)
    if not n:
        raise ValueError("a foxglove.LaserScan without ranges")
    increment = (m.end_angle - m.start_angle) / (n - 1) if n > 1 else math.tau
    given = make_scan(
        _stamp(m, arrival), number, m.ranges, m.start_angle, increment, 0.0, _RANGE_MAX, frames, m.frame_id,
        m.intensities,
    )  # fmt: skip
    if m.HasField("pose"):
        mount = compose(given.mount, planar(m.pose.position, m.pose.orientation))
        given = replace(given, mount=mount)
    yield given


def odometry(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """foxglove.Odometry; its covariance is of the pose, not of the motion, and is left out."""
    v, w = m.linear_velocity, m.angular_velocity
    given = np.array(planar(m.pose.position, m.pose.orientation))
    if not np.isfinite(given).all():
        raise ValueError("the pose is not finite")
    yield Odometry(stamp=_stamp(m, arrival), pose=given, twist=np.array((v.x, v.y, w.z)))


def transform(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """foxglove.FrameTransform."""
    pose = planar(m.translation, m.rotation)
    frames.learn(m.parent_frame_id, m.child_frame_id, pose)
    yield Transform(
        stamp=_stamp(m, arrival),
        parent=frames.ours(m.parent_frame_id),
        child=frames.ours(m.child_frame_id),
        pose=np.array(pose),
    )


def transforms(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """foxglove.FrameTransforms."""
    for each in m.transforms:
        yield from transform(each, arrival, frames, number)


def pose(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """foxglove.PoseInFrame; to a pipeline that is somebody else's estimate."""
    yield Pose(
        stamp=_stamp(m, arrival),
        role="estimate",
        pose=np.array(planar(m.pose.position, m.pose.orientation)),
        frame=frames.ours(m.frame_id),
    )


def compressed_image(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """foxglove.CompressedImage."""
    yield make_image(_stamp(m, arrival), m.data, m.format, m.frame_id)


def raw_image(m: Any, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """foxglove.RawImage."""
    yield Image(
        stamp=_stamp(m, arrival), data=m.data, encoding=m.encoding, width=m.width, height=m.height, frame=m.frame_id
    )


# Schema to our type and the function.
FOXGLOVE: dict[str, tuple[str, Convert]] = {
    "foxglove.LaserScan": ("scan", laser_scan),
    "foxglove.Odometry": ("odometry", odometry),
    "foxglove.FrameTransform": ("transform", transform),
    "foxglove.FrameTransforms": ("transform", transforms),
    "foxglove.PoseInFrame": ("pose", pose),
    "foxglove.CompressedImage": ("image", compressed_image),
    "foxglove.RawImage": ("image", raw_image),
}


def decoder(schema: str, encoding: str) -> Callable[[bytes], Any]:
    """Return what parses messages of a schema; it raises ValueError.

    Raises
    ------
    ImportError
        The installed schemas are too old to know it.
    """
    name = schema.removeprefix("foxglove.")
    cls = getattr(import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)
    fields = {name for field in cls.DESCRIPTOR.fields for name in (field.name, field.json_name)}

    def from_protobuf(data: bytes) -> Any:
        try:
            return cls.FromString(data)
        except DecodeError as error:
            raise ValueError(f"not a {schema}: {error}") from None

    def from_json(data: bytes) -> Any:
        try:
            found = _protobuf_form(msgspec.json.decode(data))
            if isinstance(found, dict) and found and not found.keys() & fields:
                raise ValueError(f"not a {schema}: it has none of its fields, but {', '.join(sorted(found))}")
            return ParseDict(found, cls(), ignore_unknown_fields=True)
        except (msgspec.DecodeError, ParseError) as error:
            raise ValueError(f"not a {schema}: {error}") from None

    return from_protobuf if encoding == "protobuf" else from_json


def _protobuf_form(value: Any) -> Any:
    """Return JSON of Foxglove's schemas as protobuf's JSON has it: times as text, null in an array as NaN."""
    if isinstance(value, dict):
        if value.keys() == {"sec", "nsec"}:
            return Timestamp(seconds=int(value["sec"]), nanos=int(value["nsec"])).ToJsonString()
        return {key: _protobuf_form(child) for key, child in value.items()}
    if isinstance(value, list):
        return ["NaN" if child is None else _protobuf_form(child) for child in value]
    return value


def _stamp(m: Any, arrival: int) -> int:
    return (m.timestamp.seconds * _SECOND + m.timestamp.nanos) or arrival
