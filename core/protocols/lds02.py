"""LDS-02 (LDROBOT LD08) on its serial line: 47-byte packets of 12 points; it only sends.

The head turns clockwise seen from above; angles of packets are the device's own, clockwise.
"""

from dataclasses import dataclass
from math import radians
from struct import Struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from knotwork.core.messages import F32, F64, I64
from knotwork.core.protocols.framing import StreamParser

BAUD = 115_200
POINTS = 12  # a packet
PACKET = 47  # bytes
SAMPLE_RATE = 2300.0  # points a second, whatever the speed
RATE = 6.0  # turns a second, about
RANGE_MIN, RANGE_MAX = 0.16, 8.0  # m

_HEADER = 0x54
_KINDS = (0x2C, 0xEC)  # both seen in the field
_FIELDS = Struct("<HH" + "HB" * POINTS + "HH")
# Optics: the emitter does not sit on the axis (mm).
_FORWARD, _SKEW, _ASIDE = 5.9, 0.11923, -20.14


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = (byte << 1) ^ (0x4D if byte & 0x80 else 0)
        table.append(byte & 0xFF)
    return tuple(table)


_CRC = _crc_table()


class Packet(NamedTuple):
    """Twelve points.

    Attributes
    ----------
    speed
        Of the head [degrees/s].
    start, end_angle
        Clockwise angles of the first and the last point [0.01 degrees].
    distances
        [mm], 0 is invalid.
    confidences
        0...255.
    time
        The device's clock [ms], wraps at 30 000 or 65 536 ms.
    end
        Position of the packet's end in the stream: bytes fed to the parser up to its last one.
    """

    speed: int
    start: int
    end_angle: int
    distances: tuple[int, ...]
    confidences: tuple[int, ...]
    time: int
    end: int


class Parser(StreamParser[Packet]):
    """Finds LDS-02 packets in a stream of bytes; a span that its speed cannot explain is refused as well."""

    header = bytes((_HEADER,))

    def _length(self, buffer: bytearray, start: int) -> int:
        if start + 1 >= len(buffer):
            return 0
        return PACKET if buffer[start + 1] in _KINDS else -1

    def _decode(self, buffer: bytearray, start: int, end: int, position: int) -> Packet | None:
        if crc8(buffer[start : end - 1]) != buffer[end - 1]:
            return None
        speed, first, *middle, last, time = _FIELDS.unpack_from(buffer, start + 2)
        if first >= 36_000 or last >= 36_000:
            return None
        # As the maker's driver: the span of the packet, in whole degrees, is at most 1.5 times the nominal one.
        if (last - first) % 36_000 // 100 > speed * POINTS / SAMPLE_RATE * 1.5:
            return None
        return Packet(speed, first, last, tuple(middle[0::2]), tuple(middle[1::2]), time, position)


def crc8(data: bytes | bytearray) -> int:
    """Return the CRC-8 with polynomial 0x4D, initial value 0, not reflected; of "123456789" it is 0xC3."""
    crc = 0
    table = _CRC
    for byte in data:
        crc = table[crc ^ byte]
    return crc


def encode(speed: int, start: int, end_angle: int, distances: list[int], confidences: list[int], time: int) -> bytes:
    """Return the 47 bytes of a packet; the arguments are those of `Packet`.

    Raises
    ------
    ValueError
        There are not twelve points.
    """
    if len(distances) != POINTS or len(confidences) != POINTS:
        raise ValueError(f"expected {POINTS} points")
    points = []
    for distance, confidence in zip(distances, confidences, strict=True):
        points += [min(max(distance, 0), 0xFFFF), min(max(confidence, 0), 0xFF)]
    fields = _FIELDS.pack(speed, start % 36_000, *points, end_angle % 36_000, time & 0xFFFF)
    body = bytes((_HEADER, _KINDS[0])) + fields
    return body + bytes((crc8(body),))


@dataclass(frozen=True, slots=True, eq=False)
class Revolution:
    """One turn of the head: points in the order of measuring.

    Attributes
    ----------
    angles : shape (n,)
        The device's clockwise angle [rad], rising from near 0 to near 2 pi.
    distances : uint16, shape (n,)
        [mm], 0 is invalid.
    confidences : uint8, shape (n,)
    packets : int32, shape (n,)
        Index into `stamps` of the packet each point came with.
    stamps : int64, shape (m,)
        What `add` was told for each packet [ns].
    speed
        Mean of the packets [degrees/s].
    missing
        Packets that the angles say were lost.
    """

    angles: F64
    distances: NDArray[np.uint16]
    confidences: NDArray[np.uint8]
    packets: NDArray[np.int32]
    stamps: I64
    speed: float
    missing: int


class Revolutions:
    """Puts packets together to turns; a turn is given when the next one begins.

    A packet that straddles zero gives its points to both turns.
    """

    def __init__(self) -> None:
        self._clear()
        self._last: Packet | None = None
        self._stamp = 0

    def add(self, packet: Packet, stamp: int) -> list[Revolution]:
        """Add a packet that was measured or arrived at `stamp` [ns]; return the turns that are over.

        A silence of more than half a turn ends a turn as well.
        """
        over: list[Revolution] = []
        last, pause = self._last, stamp - self._stamp
        self._last, self._stamp = packet, stamp
        step = (packet.end_angle - packet.start) % 36_000 / (POINTS - 1)
        if last is not None:
            turn = 360e9 / max(packet.speed, 1)
            if packet.start < last.end_angle or pause > 0.5 * turn:
                over += self._close()
            elif step > 0.0:
                self._missing += max(0, round(((packet.start - last.end_angle) / step - 1.0) / POINTS))
        angles = [packet.start + i * step for i in range(POINTS)]
        split = next((i for i, angle in enumerate(angles) if angle >= 36_000.0), POINTS)
        self._append(packet, stamp, angles, 0, split)
        if split < POINTS:
            over += self._close()
            self._append(packet, stamp, [a - 36_000.0 for a in angles], split, POINTS)
        return over

    def reset(self) -> None:
        """Forget the unfinished turn."""
        self._clear()
        self._last = None

    def _append(self, packet: Packet, stamp: int, angles: list[float], first: int, last: int) -> None:
        if first == last:
            return
        self._angles += angles[first:last]
        self._distances += packet.distances[first:last]
        self._confidences += packet.confidences[first:last]
        self._packets += [len(self._stamps)] * (last - first)
        self._stamps.append(stamp)
        self._speeds.append(packet.speed)

    def _close(self) -> list[Revolution]:
        if not self._angles:
            return []
        revolution = Revolution(
            angles=np.radians(np.array(self._angles) * 0.01),
            distances=np.array(self._distances, dtype=np.uint16),
            confidences=np.array(self._confidences, dtype=np.uint8),
            packets=np.array(self._packets, dtype=np.int32),
            stamps=np.array(self._stamps, dtype=np.int64),
            speed=sum(self._speeds) / len(self._speeds),
            missing=self._missing,
        )
        self._clear()
        return [revolution]

    def _clear(self) -> None:
        self._angles: list[float] = []
        self._distances: list[int] = []
        self._confidences: list[int] = []
        self._packets: list[int] = []
        self._stamps: list[int] = []
        self._speeds: list[int] = []
        self._missing = 0


def corrected(angles: F64, distances: NDArray[np.uint16]) -> tuple[F64, F64]:
    """Correct for the emitter beside the axis, and turn clockwise into counter-clockwise.

    Parameters
    ----------
    angles : shape (n,)
        Clockwise, of the device [rad].
    distances : shape (n,)
        [mm], 0 is invalid.

    Returns
    -------
    angles : shape (n,)
        Counter-clockwise, in [0, 2 pi) [rad].
    ranges : shape (n,)
        [m], NaN where invalid.
    """
    d = distances.astype(np.float64)
    x, y = d + _FORWARD, _SKEW * d + _ASIDE
    ranges = np.where(distances > 0, np.hypot(x, y) * 1e-3, np.nan)
    return np.mod(np.arctan2(y, x) - angles, 2.0 * np.pi), ranges


def binned(
    angles: F64, ranges: F64, values: NDArray[np.uint8], bins: int, limit: float = radians(0.5)
) -> tuple[F32, F32]:
    """Put points into a fixed number of beams; of two in one beam the nearer wins.

    Parameters
    ----------
    angles, ranges, values : shape (n,)
        Counter-clockwise [rad], [m] with NaN for invalid, anything that goes along (confidences).
    bins
        Beams of the result; beam i points at 2 pi i / bins.
    limit
        Largest distance of a point from its beam's direction [rad].

    Returns
    -------
    ranges, values : float32, shape (bins,), NaN and 0 where there is no point
    """
    width = 2.0 * np.pi / bins
    place = np.rint(angles / width)
    usable = np.isfinite(ranges) & (np.abs(angles - place * width) <= limit)
    order = np.flatnonzero(usable)
    order = order[np.argsort(-ranges[order], kind="stable")]  # the nearest is written last
    index = place[order].astype(np.int64) % bins
    beams = np.full(bins, np.nan, dtype=np.float32)
    carried = np.zeros(bins, dtype=np.float32)
    beams[index] = ranges[order]
    carried[index] = values[order]
    return beams, carried
