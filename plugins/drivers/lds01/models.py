"""From the bytes of each lidar to scans."""

from abc import ABC, abstractmethod
from math import pi, tau
from typing import Any

import numpy as np

from knotwork.core.messages import F32, Scan
from knotwork.core.protocols import lds01, lds02
from knotwork.core.protocols.framing import StreamParser
from knotwork.plugins.drivers.lds01 import Config

_BITS = 10  # of a byte on the line


class Model(ABC):
    """One lidar's stream: bytes in, scans out.

    Attributes
    ----------
    parser
        Counts what it had to reject.
    missing
        Packets that never arrived.
    rpm
        Speed of the head over the last turn.
    """

    baud: int
    packet_size: int
    start_command = b""
    stop_command = b""
    speeds: tuple[float, float]  # rpm of a healthy motor
    parser: StreamParser[Any]

    def __init__(self, config: Config) -> None:
        self.config = config
        self.missing = 0
        self.rpm = 0.0
        self.scans = 0
        self._entered = True  # the first turn is one that was entered somewhere

    def feed(self, data: bytes, now: int) -> tuple[int, list[Scan]]:
        """Take bytes that had arrived by `now` [ns]; return how many packets they completed, and scans."""
        packets = self.parser.feed(data)
        scans: list[Scan] = []
        for packet in packets:
            behind = self.parser.received - packet.end  # bytes that came after it
            # When its first byte set out, which is when its last reading had been taken.
            scans += self._add(packet, now - round((behind + self.packet_size) * _BITS * 1e9 / self.baud))
        return len(packets), scans

    @abstractmethod
    def _add(self, packet: Any, sent: int) -> list[Scan]:
        """Take a packet that was sent at `sent` [ns], or earlier; return the scans it ends."""

    @abstractmethod
    def reset(self) -> None:
        """Forget an unfinished turn."""

    def _cut(self, missing: int) -> bool:
        """Tell whether this is the first turn, and not a whole one."""
        entered, self._entered = self._entered, False
        return entered and missing > 0

    def _scan(
        self, stamp: int, ranges: F32, intensities: F32, limits: tuple[float, float], offset: float, increment: float
    ) -> Scan:
        scan = Scan(
            stamp=stamp,
            scan_id=self.scans,
            ranges=ranges,
            angle_min=self.config.zero,
            angle_increment=tau / len(ranges),
            range_min=limits[0],
            range_max=limits[1],
            mount=self.config.mount,
            time_offset=offset,
            time_increment=increment,
            intensities=intensities,
            frame=self.config.frame,
        )
        self.scans += 1
        return scan


class Lds01(Model):
    """LDS-01: 360 readings a turn, clockwise; raw reading n is beam 359 - n."""

    baud = lds01.BAUD
    packet_size = lds01.PACKET
    start_command = lds01.START
    stop_command = lds01.STOP
    speeds = (290.0, 310.0)

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.parser = lds01.Parser()
        self._turns = lds01.Revolutions()

    def reset(self) -> None:
        """Forget an unfinished turn; the next one is entered in the middle."""
        self.parser.reset()
        self._entered = True
        self._turns.reset()

    def _add(self, packet: lds01.Packet, sent: int) -> list[Scan]:
        return [self._convert(turn) for turn in self._turns.add(packet, sent) if not self._cut(turn.missing)]

    def _convert(self, turn: lds01.Revolution) -> Scan:
        self.missing += turn.missing
        self.rpm = turn.rpm
        step = 1.0 / (6.0 * turn.rpm) if turn.rpm > 0.0 else 1.0 / (360.0 * lds01.RATE)
        # Bytes come late, never early: the packet that was least late tells when the turn began.
        sectors = np.flatnonzero(turn.sectors)
        last = lds01.BEAMS * (sectors + 1) - 1
        begun = turn.stamps[sectors] - np.rint(last * (step * 1e9)).astype(np.int64)
        n = len(turn.distances)
        ranges = turn.distances[::-1].astype(np.float32) * np.float32(1e-3)
        ranges[ranges == 0.0] = np.nan
        intensities = turn.intensities[::-1].astype(np.float32)
        limits = (lds01.RANGE_MIN, lds01.RANGE_MAX)
        return self._scan(int(begun.min()), ranges, intensities, limits, (n - 1) * step, -step)


class Lds02(Model):
    """LDS-02: points at varying angles, put into a fixed number of beams."""

    baud = lds02.BAUD
    packet_size = lds02.PACKET
    speeds = (290.0, 800.0)

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.parser = lds02.Parser()
        self._turns = lds02.Revolutions()

    def reset(self) -> None:
        """Forget an unfinished turn; the next one is entered in the middle."""
        self.parser.reset()
        self._entered = True
        self._turns.reset()

    def _add(self, packet: lds02.Packet, sent: int) -> list[Scan]:
        return [self._convert(turn) for turn in self._turns.add(packet, sent) if not self._cut(1)]

    def _convert(self, turn: lds02.Revolution) -> Scan:
        self.missing += turn.missing
        self.rpm = turn.speed / 6.0
        rate = np.radians(max(turn.speed, 1.0))
        # A packet sets out after its last point; the least late of them tells (see Lds01).
        last = np.zeros(len(turn.stamps))
        np.maximum.at(last, turn.packets, turn.angles)
        begun = turn.stamps - np.rint(last / rate * 1e9).astype(np.int64)
        angles, ranges = lds02.corrected(turn.angles, turn.distances)
        n = self.config.beams
        ranges32, confidences = lds02.binned(angles, ranges, turn.confidences, n, limit=pi / n)
        # Beam i looks at 2 pi i / n, where the clockwise head was at 2 pi (1 - i / n).
        step = float(np.radians(360.0) / rate) / n
        limits = (lds02.RANGE_MIN, lds02.RANGE_MAX)
        return self._scan(int(begun.min()), ranges32, confidences, limits, n * step, -step)


def make(name: str, config: Config) -> Model:
    """Return the stream of a model, "lds01" or "lds02"."""
    return Lds01(config) if name == "lds01" else Lds02(config)
