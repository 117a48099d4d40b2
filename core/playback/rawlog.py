"""MRPT rawlogs as recordings: laser scans and odometry; plain or gzip.

A rawlog is a sequence of serialised objects: one byte 0x80 | length of the class name, the name, a
version byte, the fields, an end byte 0x88 (MRPT, `CArchive::WriteObject` and the `serializeFrom` of each
class). Objects have no length, so after a class that is not known here the next known one is searched
for. Sensory frames and action collections are only brackets around what stands in them.
"""

import gzip
import math
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.errors import InputError
from knotwork.core.geometry import Pose2, compose
from knotwork.core.messages import Message, Odometry, Scan
from knotwork.core.playback.frames import Frames
from knotwork.core.playback.recording import Recording, Track, parts

_EPOCH = 116_444_736_000_000_000  # 1970 in MRPT's clock: units of 100 ns since 1601
_END = 0x88
_TILT = 0.1  # rad; a scan plane further from the floor is left out
_LIMIT = 1 << 20  # beams or entries; more is damage


@dataclass(slots=True)
class RawScan:
    """CObservation2DRangeScan, as far as it is needed."""

    aperture: float
    counter_clockwise: bool
    range_max: float
    rotation: NDArray[np.float64]  # (3, 3), of the sensor on the robot
    position: tuple[float, float, float]
    ranges: NDArray[np.float32]
    valid: NDArray[np.uint8]


@dataclass(slots=True)
class RawOdometry:
    """A pose of the robot in its odometry, and twist (vx, vy, yaw rate) or None."""

    pose: Pose2
    twist: Pose2 | None = None


@dataclass(slots=True)
class _Item:
    kind: str  # "scan", "odometry", "motion" (an increment)
    label: str
    stamp: int  # ns since 1970, 0: not stated
    what: Any


@dataclass(slots=True)
class _Reader:
    """Reads fields at a place; struct.error at the end of the data."""

    data: bytes
    at: int = 0
    unknown: dict[str, int] = field(default_factory=dict)

    def take(self, form: str) -> Any:
        """Return the fields of a struct format; one alone as itself."""
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return values[0] if len(values) == 1 else values

    def array(self, kind: Any, n: int) -> NDArray[Any]:
        """Return n numbers."""
        if n > _LIMIT:
            raise ValueError(f"claims {n} entries")
        out = np.frombuffer(self.data, kind, n, self.at)
        self.at += out.nbytes
        return out

    def text(self) -> str:
        """Return a string."""
        return self.array(np.uint8, self.take("I")).tobytes().decode("latin-1")

    def stamp(self) -> int:
        """Return a time in ns since 1970, 0 for none."""
        ticks: int = self.take("Q")
        return (ticks - _EPOCH) * 100 if ticks > _EPOCH else 0

    def head(self) -> tuple[str, int]:
        """Return class name and version of the object that begins here; the name is without its namespace."""
        length = self.take("B")
        if not length & 0x80:
            raise ValueError("not an object")
        name = self.data[self.at : self.at + (length & 0x7F)].decode("latin-1")
        self.at += length & 0x7F
        return name.rpartition("::")[2], self.take("B")

    def nested(self, kinds: dict[str, Callable[["_Reader", int], Any]]) -> Any:
        """Read an object that must be one of these, and its end."""
        name, version = self.head()
        if name not in kinds:
            raise ValueError(f"a {name} within an object")
        found = kinds[name](self, version)
        if self.take("B") != _END:
            raise ValueError(f"{name} of version {version} does not end where it should")
        return found


def _matrix(kind: str) -> Callable[[_Reader, int], NDArray[np.float64]]:
    def read(reader: _Reader, version: int) -> NDArray[np.float64]:
        rows, columns = reader.take("II")
        return reader.array(kind, rows * columns).reshape(rows, columns).astype(np.float64)

    return read


_MATRICES = {"CMatrix": _matrix("<f4"), "CMatrixF": _matrix("<f4"), "CMatrixD": _matrix("<f8")}


def _pose3(reader: _Reader, version: int) -> tuple[tuple[float, float, float], NDArray[np.float64]]:
    """Return position and rotation (3, 3) of a CPose3D."""
    if version in (0, 1):
        matrix = reader.nested(_MATRICES)
        return tuple(matrix[:3, 3].tolist()), matrix[:3, :3]
    if version == 2:
        x, y, z, r, i, j, k = reader.take("7d")
        rotation = np.array(
            [
                [1 - 2 * (j * j + k * k), 2 * (i * j - r * k), 2 * (i * k + r * j)],
                [2 * (i * j + r * k), 1 - 2 * (i * i + k * k), 2 * (j * k - r * i)],
                [2 * (i * k - r * j), 2 * (j * k + r * i), 1 - 2 * (i * i + j * j)],
            ]
        )
        return (x, y, z), rotation
    if version == 3:
        x, y, z = reader.take("3d")
        return (x, y, z), reader.array("<f8", 9).reshape(3, 3)
    raise ValueError(f"CPose3D of version {version}")


def _pose2(reader: _Reader, version: int) -> Pose2:
    if version not in (0, 1):
        raise ValueError(f"CPose2D of version {version}")
    pose: Pose2 = reader.take("3d" if version else "3f")
    return pose


def _scan(reader: _Reader, version: int) -> _Item:
    if version > 7:
        raise ValueError(f"CObservation2DRangeScan of version {version}")
    aperture, counter_clockwise, range_max = reader.take("f?f")
    position, rotation = reader.nested({"CPose3D": _pose3})
    if version < 6:
        reader.nested(_MATRICES)
    n = reader.take("I")
    ranges = reader.array("<f4", n)
    valid = reader.array(np.uint8, n) if version >= 1 else (ranges < range_max).astype(np.uint8)
    if version >= 2:
        reader.take("f")
    stamp = reader.stamp() if version >= 3 else 0
    label = ""
    if version >= 4:
        reader.take("f")
    if version >= 5:
        label = reader.text()
        reader.take("d")
    if version >= 7 and reader.take("?"):
        reader.array("<i4", n)
    found = RawScan(aperture, counter_clockwise, range_max, rotation, position, ranges, valid)
    return _Item("scan", label, stamp, found)


def _odometry(reader: _Reader, version: int) -> _Item:
    if version > 2:
        raise ValueError(f"CObservationOdometry of version {version}")
    pose = reader.nested({"CPose2D": _pose2})
    label = reader.text()
    stamp = reader.stamp()
    twist: Pose2 | None = None
    if version >= 1:
        if reader.take("?") or version < 2:
            reader.take("ii")
        known = reader.take("?")
        if version < 2:
            v, w = reader.take("ff")
            twist = (v, 0.0, w) if known else None
        elif known:
            twist = reader.take("3d")
    return _Item("odometry", label, stamp, RawOdometry(pose, twist))


def _motion(reader: _Reader, version: int) -> _Item:
    """CActionRobotMovement2D that came from odometry."""
    if not 4 <= version <= 7:
        raise ValueError(f"CActionRobotMovement2D of version {version}")
    if reader.take("i") != 0:
        raise ValueError("a movement that is not from odometry")
    step = reader.nested({"CPose2D": _pose2})
    reader.take("i6f")
    reader.take("i6f" if version >= 5 else "i4f")
    known = reader.take("?")
    if version < 7:
        reader.take("ff")
        reader.take("?ii")
    else:
        if known:
            reader.take("3d")
        if reader.take("?"):
            reader.take("ii")
    return _Item("motion", "", reader.stamp() if version >= 6 else 0, step)


_KNOWN: dict[str, Callable[[_Reader, int], _Item]] = {
    "CObservation2DRangeScan": _scan,
    "CObservationOdometry": _odometry,
    "CActionRobotMovement2D": _motion,
}
_BRACKETS = {"CSensoryFrame": {0: "IQI", 1: "II", 2: "I"}, "CActionCollection": {0: "I"}}
_HEADS = re.compile(
    b"|".join(
        re.escape(bytes([0x80 | len(name)]) + name.encode())
        for known in (*_KNOWN, *_BRACKETS)
        for name in (known, f"mrpt::obs::{known}")
    )
)


class RawlogRecording(Recording):
    """One rawlog; it is unpacked into memory.

    Raises
    ------
    InputError
        It cannot be read, or holds neither scans nor odometry.
    """

    def __init__(self, path: str) -> None:
        super().__init__()
        self._path = path
        files = parts(path)
        if len(files) != 1:
            raise InputError("several rawlogs: expected one", where=path)
        try:
            self._data, cut = _unpacked(files[0].read_bytes())
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}", where=path) from error
        if cut:
            self.damages.add("cut_files", f"{path}: {cut}; what came before it was read")
        self._reader = _Reader(self._data)
        for topic, arrival, item in self._items():
            self.start = min(self.start or arrival, arrival)
            self.end = max(self.end, arrival)
            track = self.tracks.get(topic)
            if track is None:
                convert = convert_scan if isinstance(item, RawScan) else convert_odometry
                kind = "scan" if isinstance(item, RawScan) else "odometry"
                track = self.tracks[topic] = Track(topic, kind, "", lambda given: given, convert)
            track.count += 1
        self.other = {name: f"{n} objects" for name, n in self._reader.unknown.items()}
        if not self.tracks:
            raise InputError("a rawlog without scans and odometry, or none at all", where=path)

    def messages(self, start: int, stop: int | None) -> Iterator[tuple[Track, int, Any]]:
        """Yield track, stamp [ns] and object in the file's order."""
        self._reader = _Reader(self._data)
        for topic, arrival, item in self._items():
            if arrival >= start and (stop is None or arrival <= stop):
                yield self.tracks[topic], arrival, item

    def _items(self) -> Iterator[tuple[str, int, Any]]:
        """Yield topic, time [ns] and object; increments are summed to poses, given with the next scan."""
        place: Pose2 = (0.0, 0.0, 0.0)
        moved = False
        time = 0
        for item in self._objects():
            time = max(time, item.stamp)
            if item.kind == "motion":
                place, moved = compose(place, item.what), True
                continue
            if moved:
                moved = False
                yield "odometry", item.stamp or time, RawOdometry(place)
            yield item.label or item.kind, item.stamp or time, item.what

    def _objects(self) -> Iterator[_Item]:
        reader = self._reader
        size = len(reader.data)
        while reader.at < size:
            begin = reader.at
            if reader.data[begin] == _END:
                reader.at += 1
                continue
            try:
                name, version = reader.head()
                if name in _BRACKETS and version in _BRACKETS[name]:
                    reader.take(_BRACKETS[name][version])
                    continue
                if name not in _KNOWN:
                    raise ValueError(name)
                item = _KNOWN[name](reader, version)
                if reader.take("B") != _END:
                    raise ValueError(f"{name} of version {version} does not end where it should")
            except (struct.error, ValueError) as error:
                self._leave_out(error, begin)
                continue
            yield item

    def _leave_out(self, error: Exception, begin: int) -> None:
        """Count what cannot be read and go to the next object that can."""
        reader = self._reader
        text = "cut short" if isinstance(error, struct.error) else str(error)
        name = text if text.isidentifier() else f"byte {begin}: {text}"
        reader.unknown[name] = reader.unknown.get(name, 0) + 1
        found = _HEADS.search(reader.data, begin + 1)
        reader.at = found.start() if found is not None else len(reader.data)


def convert_scan(m: RawScan, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """Return a scan; what MRPT marks invalid is no return from `range_max` on, else invalid."""
    n = len(m.ranges)
    if n < 2 or not (0.0 < m.aperture <= 7.0 and m.range_max > 0.0):
        raise ValueError(f"a scan of {n} beams over {m.aperture} rad")
    if abs(m.rotation[2, 2]) < math.cos(_TILT):
        raise ValueError("a scan whose plane is tilted")
    ranges = m.ranges.astype(np.float32)
    far = ranges >= m.range_max
    ranges[m.valid == 0] = np.nan
    ranges[ranges <= 0.0] = np.nan
    ranges[far] = np.inf
    upside_down = m.rotation[2, 2] < 0.0
    if m.counter_clockwise == upside_down:  # seen from above the beams run clockwise
        ranges = ranges[::-1].copy()
    yaw = math.atan2(m.rotation[1, 0], m.rotation[0, 0])
    yield Scan(
        stamp=arrival,
        scan_id=number,
        ranges=ranges,
        angle_min=-0.5 * m.aperture,
        angle_increment=m.aperture / (n - 1),
        range_min=0.0,
        range_max=m.range_max,
        mount=(m.position[0], m.position[1], yaw),
    )


def convert_odometry(m: RawOdometry, arrival: int, frames: Frames, number: int) -> Iterator[Message]:
    """Return odometry."""
    pose = np.array(m.pose)
    if not np.isfinite(pose).all():
        raise ValueError("the pose is not finite")
    yield Odometry(stamp=arrival, pose=pose, twist=None if m.twist is None else np.array(m.twist))


def _unpacked(data: bytes) -> tuple[bytes, str]:
    """Return the bytes of a file, and why they end too early ("" when they do not)."""
    if not data.startswith(b"\x1f\x8b"):
        return data, ""
    try:
        return gzip.decompress(data), ""
    except (EOFError, OSError, zlib.error) as error:
        partial = zlib.decompressobj(wbits=31)
        try:
            return partial.decompress(data), f"its gzip stream is cut short ({error})"
        except zlib.error:
            return b"", f"its gzip stream is damaged ({error})"
