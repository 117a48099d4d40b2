"""LDS-01 (HLDS HLS-LFCD2) on its serial line: 42-byte packets of six degrees, sixty to a turn.

The head turns clockwise seen from above; everything here keeps the device's own clockwise order.
"""

from dataclasses import dataclass
from struct import Struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from knotwork.core.messages import I64
from knotwork.core.protocols.framing import StreamParser

BAUD = 230_400
START, STOP = b"b", b"e"  # no line ending, no reply
SECTORS = 60  # packets a turn
BEAMS = 6  # readings a packet
PACKET = 42  # bytes
RATE = 5.0  # turns a second, nominal
RANGE_MIN, RANGE_MAX = 0.12, 3.5  # m

_HEADER = 0xFA
_FIRST = 0xA0
_FIELDS = Struct("<H" + "HHxx" * BEAMS)  # speed, then intensity and distance of each reading
_WORDS = Struct("<BBH" + "HHH" * BEAMS)


class Packet(NamedTuple):
    """Six readings.

    Attributes
    ----------
    sector
        0 to 59; reading i is the raw clockwise sample 6 * sector + i.
    rpm
        Speed of the motor [1/min].
    distances, intensities
        [mm], 0 is invalid; as the device gives it.
    end
        Position of the packet's end in the stream: bytes fed to the parser up to its last one.
    """

    sector: int
    rpm: float
    distances: tuple[int, ...]
    intensities: tuple[int, ...]
    end: int


class Parser(StreamParser[Packet]):
    """Finds LDS-01 packets in a stream of bytes."""

    header = bytes((_HEADER,))

    def _length(self, buffer: bytearray, start: int) -> int:
        if start + 1 >= len(buffer):
            return 0
        return PACKET if _FIRST <= buffer[start + 1] < _FIRST + SECTORS else -1

    def _decode(self, buffer: bytearray, start: int, end: int, position: int) -> Packet | None:
        check = checksum(buffer[start : end - 2])
        if buffer[end - 2] != check or buffer[end - 1] != check:
            return None
        fields = _FIELDS.unpack_from(buffer, start + 2)
        return Packet(buffer[start + 1] - _FIRST, fields[0] * 0.1, fields[2::2], fields[1::2], position)


def checksum(body: bytes | bytearray) -> int:
    """Return the check byte over the first 40 bytes; it is sent twice."""
    return 0xFF - (sum(body) & 0xFF)


def encode(sector: int, rpm: float, distances: list[int], intensities: list[int]) -> bytes:
    """Return the 42 bytes of a packet; distances [mm] and intensities are clamped to 16 bits.

    Raises
    ------
    ValueError
        `sector` is not in 0...59, or there are not six readings.
    """
    if not 0 <= sector < SECTORS or len(distances) != BEAMS or len(intensities) != BEAMS:
        raise ValueError(f"expected a sector below {SECTORS} and {BEAMS} readings")
    words = []
    for distance, intensity in zip(distances, intensities, strict=True):
        words += [_u16(intensity), _u16(distance), 0]
    body = _WORDS.pack(_HEADER, _FIRST + sector, _u16(round(rpm * 10.0)), *words)
    return body + bytes((checksum(body),)) * 2


def _u16(value: int) -> int:
    return min(max(value, 0), 0xFFFF)


def _follows(packet: Packet, before: Packet) -> bool:
    """Tell whether a packet's sector is as far from an earlier one's as the bytes between them say.

    Bytes are lost, not added: the sector may be a little further, one packet for half a turn.
    """
    steps, rest = divmod(packet.end - before.end, PACKET)
    steps += rest > PACKET // 2
    return (packet.sector - before.sector - steps) % SECTORS <= 1 + steps // (SECTORS // 2)


@dataclass(frozen=True, slots=True, eq=False)
class Revolution:
    """One turn of the head, in the device's clockwise order.

    Attributes
    ----------
    distances : uint16, shape (360,)
        [mm], 0 where invalid or missing.
    intensities : uint16, shape (360,)
    sectors : bool, shape (60,)
        Which packets arrived.
    stamps : int64, shape (60,)
        What `add` was told for each packet [ns], 0 where missing.
    rpm
        Mean of the packets [1/min].
    """

    distances: NDArray[np.uint16]
    intensities: NDArray[np.uint16]
    sectors: NDArray[np.bool_]
    stamps: I64
    rpm: float

    @property
    def missing(self) -> int:
        """Number of packets that did not arrive."""
        return SECTORS - int(self.sectors.sum())


class Revolutions:
    """Puts packets together to turns; a turn is given at its last packet, or when the next one begins.

    A sum of bytes lets some damaged packets through. One whose sector is not where the stream has come to is
    put aside; the next packet tells whether it was damaged, or whether bytes were lost by the turn.

    Attributes
    ----------
    misplaced
        Packets that were given up because of their sector.
    """

    def __init__(self) -> None:
        self.misplaced = 0
        self._last = -1  # sector of the last packet of this turn
        self._stamp = 0
        self._before: Packet | None = None  # the last one that was believed
        self._aside: tuple[Packet, int] | None = None  # with its stamp
        self._clear()

    def add(self, packet: Packet, stamp: int) -> list[Revolution]:
        """Add a packet that was measured or arrived at `stamp` [ns]; return the turns that are over.

        A silence that is half a turn longer than the sector numbers explain ends a turn as well.
        """
        aside, self._aside = self._aside, None
        if self._before is None or _follows(packet, self._before):
            self.misplaced += aside is not None
            return self._take(packet, stamp)
        if aside is not None and _follows(packet, aside[0]):
            return self._take(*aside) + self._take(packet, stamp)
        self.misplaced += aside is not None
        self._aside = packet, stamp
        return []

    def _take(self, packet: Packet, stamp: int) -> list[Revolution]:
        self._before = packet
        over: list[Revolution] = []
        if self._last >= 0:
            turn = 60e9 / packet.rpm if packet.rpm > 0.0 else 1e9 / RATE
            steps = packet.sector - self._last
            if steps <= 0 or stamp - self._stamp > (steps / SECTORS + 0.5) * turn:
                over.append(self._close())
        k = packet.sector
        self._distances[k] = packet.distances
        self._intensities[k] = packet.intensities
        self._sectors[k] = True
        self._stamps[k] = stamp
        self._speeds.append(packet.rpm)
        self._last, self._stamp = k, stamp
        if k == SECTORS - 1:
            over.append(self._close())
        return over

    def reset(self) -> None:
        """Forget the unfinished turn."""
        self._before = self._aside = None
        self._clear()

    def _close(self) -> Revolution:
        revolution = Revolution(
            distances=self._distances.reshape(-1),
            intensities=self._intensities.reshape(-1),
            sectors=self._sectors,
            stamps=self._stamps,
            rpm=sum(self._speeds) / len(self._speeds),
        )
        self._clear()
        return revolution

    def _clear(self) -> None:
        self._distances = np.zeros((SECTORS, BEAMS), dtype=np.uint16)
        self._intensities = np.zeros((SECTORS, BEAMS), dtype=np.uint16)
        self._sectors = np.zeros(SECTORS, dtype=np.bool_)
        self._stamps = np.zeros(SECTORS, dtype=np.int64)
        self._speeds: list[float] = []
        self._last = -1
