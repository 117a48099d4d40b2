"""LDS-03 (COIN-D4) on its serial line: packets of a varying number of samples; it waits for a start command.

The makers' documents disagree about the baud rate and about an angle correction; this follows their own
driver for the rate and corrects nothing. Angles are the device's own, clockwise.
"""

from dataclasses import dataclass
from functools import reduce
from operator import xor
from struct import Struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from knotwork.core.messages import F64, I64
from knotwork.core.protocols.framing import StreamParser

BAUD = 230_400  # the manual says 115 200
START, STOP = bytes.fromhex("AA 55 F0 0F"), bytes.fromhex("AA 55 F5 0A")
RATE = 10.0  # turns a second
SAMPLE_RATE = 4000.0  # samples a second
BYTES_A_SAMPLE = 3.25  # with a header for each forty
RANGE_MIN, RANGE_MAX = 0.05, 12.0  # m

_HEAD = 10  # bytes before the samples
_SAMPLE = 3  # bytes
_FIELDS = Struct("<HBBHHH")
_WORDS = Struct("<5H")
_MAGIC = 0x55AA


class Packet(NamedTuple):
    """Some samples.

    Attributes
    ----------
    starts
        It is the first of a turn.
    rate
        Turns a second, told by the first packet of a turn; 0 in others.
    first, last
        Clockwise angles of the first and the last sample, below 360 [degrees].
    distances
        [mm], 0 is invalid.
    intensities
        0...255.
    end
        Position of the packet's end in the stream: bytes fed to the parser up to its last one.
    """

    starts: bool
    rate: float
    first: float
    last: float
    distances: tuple[int, ...]
    intensities: tuple[int, ...]
    end: int

    @property
    def size(self) -> int:
        """Bytes on the wire."""
        return _HEAD + _SAMPLE * len(self.distances)


class Parser(StreamParser[Packet]):
    """Finds LDS-03 packets in a stream of bytes."""

    header = b"\xaa\x55"

    def _length(self, buffer: bytearray, start: int) -> int:
        if start + _HEAD > len(buffer):
            return 0
        samples, angles = buffer[start + 3], buffer[start + 4] & buffer[start + 6] & 1
        return _HEAD + _SAMPLE * samples if samples and angles else -1

    def _decode(self, buffer: bytearray, start: int, end: int, position: int) -> Packet | None:
        if _checksum(buffer[start:end]) != 0:
            return None
        _, kind, _, first, last, _ = _FIELDS.unpack_from(buffer, start)
        if max(first, last) >> 1 >= 360 * 64:
            return None
        low, middle, high = (buffer[start + _HEAD + i : end : _SAMPLE] for i in range(_SAMPLE))
        return Packet(
            bool(kind & 1),
            (kind >> 1) * 0.1 if kind & 1 else 0.0,
            (first >> 1) / 64.0,
            (last >> 1) / 64.0,
            tuple(c * 64 + (b >> 2) for b, c in zip(middle, high, strict=True)),
            tuple((b & 3) * 64 + (a >> 2) for a, b in zip(low, middle, strict=True)),
            position,
        )


def _checksum(packet: bytes | bytearray) -> int:
    """Return the XOR of the packet's 16-bit words; a sample is its first byte and the word of the other two."""
    total = reduce(xor, _WORDS.unpack_from(packet))
    first, second, third = (reduce(xor, packet[_HEAD + i :: _SAMPLE]) for i in range(_SAMPLE))
    return int(total ^ first ^ second ^ third << 8)


def encode(starts: bool, rate: float, first: float, last: float, distances: list[int], intensities: list[int]) -> bytes:
    """Return a packet; the arguments are those of `Packet`, distances below 16384 mm.

    Raises
    ------
    ValueError
        No sample, more than 255, or not as many intensities as distances.
    """
    if not 0 < len(distances) <= 255 or len(distances) != len(intensities):
        raise ValueError("expected 1 to 255 samples, each with an intensity")
    samples = bytearray()
    for distance, intensity in zip(distances, intensities, strict=True):
        d, i = min(max(distance, 0), 0x3FFF), min(max(intensity, 0), 0xFF)
        samples += bytes(((i & 63) << 2, (d & 63) << 2 | i >> 6, d >> 6))
    kind = 1 | round(rate * 10.0) << 1 if starts else 0
    angles = (round(angle * 64.0) % (360 * 64) << 1 | 1 for angle in (first, last))
    packet = bytearray(_FIELDS.pack(_MAGIC, kind, len(distances), *angles, 0)) + samples
    packet[8:10] = _checksum(packet).to_bytes(2, "little")
    return bytes(packet)


@dataclass(frozen=True, slots=True, eq=False)
class Revolution:
    """One turn of the head: samples in the order of measuring.

    Attributes
    ----------
    angles : shape (n,)
        The device's clockwise angle since the turn's zero [rad], rising.
    distances : uint16, shape (n,)
        [mm], 0 is invalid.
    intensities : uint8, shape (n,)
    packets : int32, shape (n,)
        Index into `stamps` of the packet each sample came with.
    stamps : int64, shape (m,)
        What `add` was told for each packet [ns].
    rate
        Turns a second; 0 if the packet that tells it was lost.
    whole
        It began with the packet that starts a turn.
    """

    angles: F64
    distances: NDArray[np.uint16]
    intensities: NDArray[np.uint8]
    packets: NDArray[np.int32]
    stamps: I64
    rate: float
    whole: bool


class Revolutions:
    """Puts packets together to turns; a turn is given when the next one begins."""

    def __init__(self) -> None:
        self._packets: list[tuple[Packet, int]] = []

    def add(self, packet: Packet, stamp: int) -> list[Revolution]:
        """Add a packet that was measured or arrived at `stamp` [ns]; return the turns that are over.

        Angles that fall and a silence of more than half a turn end a turn as well.
        """
        over: list[Revolution] = []
        if self._packets:
            last, before = self._packets[-1]
            silent = stamp - before > 0.5e9 / RATE
            if packet.starts or silent or packet.first < last.first:
                over.append(self._close())
        self._packets.append((packet, stamp))
        return over

    def reset(self) -> None:
        """Forget the unfinished turn."""
        self._packets = []

    def _close(self) -> Revolution:
        packets, self._packets = self._packets, []
        angles = []
        for packet, _ in packets:
            span = (packet.last - packet.first) % 360.0
            angles.append(packet.first + np.linspace(0.0, span, len(packet.distances)))
        return Revolution(
            angles=np.radians(np.concatenate(angles)),
            distances=np.array([d for p, _ in packets for d in p.distances], dtype=np.uint16),
            intensities=np.array([i for p, _ in packets for i in p.intensities], dtype=np.uint8),
            packets=np.repeat(np.arange(len(packets), dtype=np.int32), [len(p.distances) for p, _ in packets]),
            stamps=np.array([stamp for _, stamp in packets], dtype=np.int64),
            rate=packets[0][0].rate,
            whole=packets[0][0].starts,
        )
