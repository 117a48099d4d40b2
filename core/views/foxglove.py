"""Views under Foxglove's schemas (https://docs.foxglove.dev/docs/sdk/schemas), as protobuf.

Frames: `map` > `odom` > `base`. A scan is stated in `base` with the sensor's mount as its origin, so
a viewer needs no more than the transforms. Time stamps are the messages' `stamp`.
"""

import struct
from functools import lru_cache
from math import cos, sin
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Grid_pb2 import Grid as GridView
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from knotwork.core.messages import Event, Grid, Image, Odometry, Pose, Scan, Trajectory, Transform
from knotwork.core.views import wire
from knotwork.core.views.table import View

BASE = "base"  # frame that scans and poses speak of
TRANSFORMS = "/tf"

_SECOND = 1_000_000_000
# The numbers below are fields of the schemas; protobuf never changes one once it is published.
_ANGLES = struct.Struct("<BdBd")


def scan(message: Scan) -> bytes:
    """Scan to foxglove.LaserScan."""
    end = message.angle_min + max(len(message.ranges) - 1, 0) * message.angle_increment
    data = (
        wire.stamp(1, message.stamp)
        + _sensor(*message.mount)
        + _ANGLES.pack(4 << 3 | 1, message.angle_min, 5 << 3 | 1, end)
        + wire.doubles(6, message.ranges)
    )
    if message.intensities is not None:
        data += wire.doubles(7, message.intensities)
    return data


def pose(message: Pose) -> bytes:
    """Pose to foxglove.PoseInFrame."""
    return wire.stamp(1, message.stamp) + wire.text(2, message.frame) + wire.pose(3, *message.pose.tolist())


def trajectory(message: Trajectory) -> bytes:
    """Trajectory to foxglove.PosesInFrame."""
    return wire.stamp(1, message.stamp) + wire.text(2, message.frame) + wire.poses(3, message.poses)


def odometry_transform(message: Odometry) -> bytes:
    """Odometry to foxglove.FrameTransform."""
    return _transform(message.stamp, message.frame, message.child, message.pose)


def transform(message: Transform) -> bytes:
    """Transform to foxglove.FrameTransform."""
    return _transform(message.stamp, message.parent, message.child, message.pose)


def pose_transform(message: Pose) -> bytes | None:
    """Estimated pose to foxglove.FrameTransform; shown where no odometry places `base`."""
    return _transform(message.stamp, message.frame, BASE, message.pose) if message.role == "estimate" else None


def grid(message: Grid) -> bytes:
    """Grid to foxglove.Grid in map colours: white free, black occupied, unknown transparent."""
    rows, columns = message.cells.shape
    view = GridView(
        timestamp=_time(message.stamp),
        frame_id=message.frame,
        column_count=columns,
        row_stride=4 * columns,
        cell_stride=4,
        fields=[
            PackedElementField(name=name, offset=offset, type=PackedElementField.UINT8)
            for offset, name in enumerate(("red", "green", "blue", "alpha"))
        ],
    )
    view.cell_size.x = view.cell_size.y = message.resolution
    x, y, yaw = message.origin
    view.pose.position.x, view.pose.position.y = x, y
    view.pose.orientation.z, view.pose.orientation.w = sin(yaw / 2), cos(yaw / 2)
    if not rows * columns:
        return view.SerializeToString()
    colours = _COLOURS[np.ascontiguousarray(message.cells).view(np.uint8)]
    return b"".join((view.SerializeToString(), *wire.buffer(GridView.DATA_FIELD_NUMBER, colours)))


def event(message: Event) -> bytes:
    """Event to foxglove.Log."""
    return Log(
        timestamp=_time(message.stamp),
        level=Log.Level.Value(message.level.upper()),
        message=message.text,
        name=message.node,
    ).SerializeToString()


def compressed_image(message: Image) -> bytes | None:
    """JPEG or PNG image to foxglove.CompressedImage."""
    if message.encoding not in ("jpeg", "png"):
        return None
    return CompressedImage(
        timestamp=_time(message.stamp), frame_id=message.frame, data=message.data, format=message.encoding
    ).SerializeToString()


def raw_image(message: Image) -> bytes | None:
    """Raw image to foxglove.RawImage."""
    if message.encoding in ("jpeg", "png"):
        return None
    return RawImage(
        timestamp=_time(message.stamp),
        frame_id=message.frame,
        width=message.width,
        height=message.height,
        encoding=message.encoding,
        step=len(message.data) // max(message.height, 1),
        data=message.data,
    ).SerializeToString()


def protobuf_view(cls: Any, render: Any, **more: Any) -> View:
    """Return a view whose messages are of the protobuf class `cls`."""
    files = FileDescriptorSet()
    seen: set[str] = set()

    def add(file: FileDescriptor) -> None:
        if file.name not in seen:
            seen.add(file.name)
            for dependency in file.dependencies:
                add(dependency)
            file.CopyToProto(files.file.add())

    add(cls.DESCRIPTOR.file)
    return View(cls.DESCRIPTOR.full_name, "protobuf", files.SerializeToString(), render, **more)


@lru_cache(maxsize=16)
def _sensor(x: float, y: float, yaw: float) -> bytes:
    """Frame and origin of a scan; a mount seldom changes."""
    return wire.text(2, BASE) + wire.pose(3, x, y, yaw)


def _time(stamp: int) -> Timestamp:
    return Timestamp(seconds=stamp // _SECOND, nanos=stamp % _SECOND)


def _transform(stamp: int, parent: str, child: str, at: NDArray[np.float64]) -> bytes:
    return wire.stamp(1, stamp) + _frames(parent, child) + wire.place(4, 5, *at.tolist())


@lru_cache(maxsize=64)
def _frames(parent: str, child: str) -> bytes:
    return wire.text(2, parent) + wire.text(3, child)


def _colours() -> NDArray[np.uint32]:
    """Colour (256,) of each cell value seen as uint8, four bytes in one; -1 and others out of range are unknown."""
    table = np.zeros((256, 4), np.uint8)
    table[:101, :3] = np.linspace(255, 0, 101).round()[:, None]
    table[:101, 3] = 255
    return table.view(np.uint32).reshape(256)


_COLOURS = _colours()

FOXGLOVE_VIEWS = {
    "scan": [protobuf_view(LaserScan, scan)],
    "pose": [
        protobuf_view(PoseInFrame, pose),
        protobuf_view(FrameTransform, pose_transform, topic=TRANSFORMS, places=lambda _: BASE),
    ],
    "odometry": [
        protobuf_view(FrameTransform, odometry_transform, topic=TRANSFORMS, places=lambda message: message.child)
    ],
    "transform": [protobuf_view(FrameTransform, transform, topic=TRANSFORMS, places=lambda message: message.child)],
    "trajectory": [protobuf_view(PosesInFrame, trajectory)],
    "grid": [protobuf_view(GridView, grid)],
    "event": [protobuf_view(Log, event)],
    "image": [protobuf_view(CompressedImage, compressed_image), protobuf_view(RawImage, raw_image)],
}
