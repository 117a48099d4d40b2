"""Protobuf's wire format for the few shapes that go out many times a second.

Building message objects field by field costs twice as much as packing their fixed layout:
https://protobuf.dev/programming-guides/encoding. A tag is `field << 3 | kind`.
"""

import struct
from functools import lru_cache
from math import cos, isfinite, nan, sin
from typing import Any

import numpy as np
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

_SECOND = 1_000_000_000
_BYTES, _DOUBLE = 2, 1  # kinds

_X, _Y, _Z, _W = (field << 3 | _DOUBLE for field in (1, 2, 3, 4))
_POSITION, _ORIENTATION = (field << 3 | _BYTES for field in (1, 2))  # of a foxglove.Pose
_PLACE = struct.Struct("<BBBdBdBBBdBd")
_POSE_FIELD = struct.Struct("<BB" + _PLACE.format[1:])
_F8 = np.dtype("<f8")


def varint(value: int) -> bytes:
    """Encode an integer that is not negative."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


@lru_cache(maxsize=64)
def stamp(field: int, nanoseconds: int) -> bytes:
    """Encode a google.protobuf.Timestamp; the messages of a step share theirs."""
    seconds, nanos = divmod(nanoseconds, _SECOND)
    body = _seconds(seconds)
    if nanos:
        body += b"\x10" + varint(nanos)
    return bytes((field << 3 | _BYTES, len(body))) + body


@lru_cache(maxsize=16)
def _seconds(seconds: int) -> bytes:
    return Timestamp(seconds=seconds).SerializeToString()


@lru_cache(maxsize=256)
def text(field: int, value: str) -> bytes:
    """Encode a string, such as the name of a frame."""
    data = value.encode()
    return bytes((field << 3 | _BYTES,)) + varint(len(data)) + data


def doubles(field: int, values: NDArray[Any]) -> bytes:
    """Encode an array (n,) as a packed repeated double."""
    data = values.astype(_F8).tobytes()
    return bytes((field << 3 | _BYTES,)) + varint(len(data)) + data


def buffer(field: int, values: NDArray[Any]) -> tuple[bytes, memoryview]:
    """Return what stands before the bytes of a contiguous array, and these."""
    return bytes((field << 3 | _BYTES,)) + varint(values.nbytes), values.data.cast("B")


def place(position: int, orientation: int, x: float, y: float, yaw: float) -> bytes:
    """Encode a foxglove.Vector3 (x, y, 0) and a foxglove.Quaternion about z as these two fields."""
    half = yaw / 2 if isfinite(yaw) else nan  # sin(inf) raises
    return _PLACE.pack(
        position << 3 | _BYTES, 18, _X, x, _Y, y,
        orientation << 3 | _BYTES, 18, _Z, sin(half), _W, cos(half),
    )  # fmt: skip


def pose(field: int, x: float, y: float, yaw: float) -> bytes:
    """Encode a foxglove.Pose."""
    half = yaw / 2 if isfinite(yaw) else nan
    return _POSE_FIELD.pack(
        field << 3 | _BYTES, _PLACE.size,
        _POSITION, 18, _X, x, _Y, y, _ORIENTATION, 18, _Z, sin(half), _W, cos(half),
    )  # fmt: skip


def poses(field: int, values: NDArray[np.float64]) -> bytes:
    """Encode poses (n, 3) as a repeated foxglove.Pose."""
    out = np.zeros(len(values), _POSE)
    fixed = np.frombuffer(pose(field, 0.0, 0.0, 0.0), _POSE)
    for name in ("head", "y_tag", "z_head", "w_tag"):
        out[name] = fixed[name]
    out["x"], out["y"] = values[:, 0], values[:, 1]
    out["z"], out["w"] = np.sin(values[:, 2] / 2), np.cos(values[:, 2] / 2)
    return out.tobytes()


_POSE = np.dtype("V5, <f8, V1, <f8, V3, <f8, V1, <f8")
_POSE.names = ("head", "x", "y_tag", "y", "z_head", "z", "w_tag", "w")
