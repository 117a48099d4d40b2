"""From the bytes of each lidar to scans."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from math import pi, radians, tau
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.messages import F32, F64, I64, Scan
from knotwork.core.protocols import lds01, lds02, lds03
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
    misplaced
        Packets that were damaged though their check byte is right: they claim to be elsewhere on the turn.
    rpm
        Speed of the head over the last turn.
    traffic
        Bytes a second: after a pause of the host many packets come at once, and only the last is new.
    """

    baud: int
    traffic: float
    start_command = b""
    stop_command = b""
    speeds: tuple[float, float]  # rpm of a healthy motor
    parser: StreamParser[Any]

    def __init__(self, config: Config) -> None:
        self.config = config
        self.missing = self.misplaced = 0
        self.rpm = 0.0
        self.scans = 0
        self._entered = True  # the first turn is one that was entered somewhere

    def feed(self, data: bytes, now: int) -> tuple[int, list[Scan]]:
        """Take all bytes that had arrived by `now` [ns]; return how many packets they completed, and scans."""
        packets = self.parser.feed(data)
        scans: list[Scan] = []
        for packet in packets:
            behind = self.parser.received - packet.end  # bytes that came after it, at the lidar's own pace
            # When its first byte set out, which is when its last reading had been taken.
            ago = behind / self.traffic + self._size(packet) * _BITS / self.baud
            scans += self._add(packet, now - round(ago * 1e9))
        return len(packets), scans

    @abstractmethod
    def _size(self, packet: Any) -> int:
        """Return the length of a packet [bytes]."""

    @abstractmethod
    def _add(self, packet: Any, sent: int) -> list[Scan]:
        """Take a packet that was sent at `sent` [ns], or earlier; return the scans it ends."""

    @abstractmethod
    def reset(self) -> None:
        """Forget an unfinished turn."""

    def _binned(
        self,
        begun: int,
        rate: float,
        angles: F64,
        ranges: F64,
        values: NDArray[np.uint8],
        limits: tuple[float, float],
    ) -> Scan:
        """Return a scan of points at any counter-clockwise angles [rad]; the head turns at `rate` [rad/s]."""
        n = self.config.beams
        beams, carried = lds02.binned(angles, ranges, values, n, limit=pi / n)
        # Beam i looks at 2 pi i / n, where the clockwise head was at 2 pi (1 - i / n).
        step = tau / rate / n
        return self._scan(begun, beams, carried, limits, n * step, -step)

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
    traffic = lds01.PACKET * lds01.SECTORS * lds01.RATE
    start_command = lds01.START
    stop_command = lds01.STOP
    speeds = (290.0, 310.0)

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.parser = lds01.Parser()
        self._turns = lds01.Revolutions()
        self._speeds: list[float] = []

    def reset(self) -> None:
        """Forget an unfinished turn; the next one is entered in the middle."""
        self.parser.reset()
        self._entered = True
        self._turns.reset()

    def _size(self, packet: lds01.Packet) -> int:
        return lds01.PACKET

    def _add(self, packet: lds01.Packet, sent: int) -> list[Scan]:
        self._speeds = [*self._speeds[1 - lds01.SECTORS :], packet.rpm]
        turns = self._turns.add(packet, sent)
        self.misplaced = self._turns.misplaced
        return [self._convert(turn) for turn in turns if not self._cut(turn.missing)]

    def _convert(self, turn: lds01.Revolution) -> Scan:
        self.missing += turn.missing
        self.rpm = median(self._speeds)  # a sum of bytes lets some damaged packets through
        step = 1.0 / (6.0 * self.rpm) if self.rpm > 0.0 else 1.0 / (360.0 * lds01.RATE)
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
    traffic = lds02.PACKET / lds02.POINTS * lds02.SAMPLE_RATE
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

    def _size(self, packet: lds02.Packet) -> int:
        return lds02.PACKET

    def _add(self, packet: lds02.Packet, sent: int) -> list[Scan]:
        return [self._convert(turn) for turn in self._turns.add(packet, sent) if not self._cut(1)]

    def _convert(self, turn: lds02.Revolution) -> Scan:
        self.missing += turn.missing
        self.rpm = turn.speed / 6.0
        rate = radians(max(turn.speed, 1.0))
        angles, ranges = lds02.corrected(turn.angles, turn.distances)
        begun = _begun(turn.angles, turn.packets, turn.stamps, rate)
        return self._binned(begun, rate, angles, ranges, turn.confidences, (lds02.RANGE_MIN, lds02.RANGE_MAX))


class Lds03(Model):
    """LDS-03: samples at angles of their own, put into a fixed number of beams. Its facts are uncertain."""

    baud = lds03.BAUD
    traffic = lds03.BYTES_A_SAMPLE * lds03.SAMPLE_RATE
    start_command = lds03.START
    stop_command = lds03.STOP
    speeds = (60.0, 1200.0)

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.parser = lds03.Parser()
        self._turns = lds03.Revolutions()

    def reset(self) -> None:
        """Forget an unfinished turn; the next one is entered in the middle."""
        self.parser.reset()
        self._entered = True
        self._turns.reset()

    def _size(self, packet: lds03.Packet) -> int:
        return packet.size

    def _add(self, packet: lds03.Packet, sent: int) -> list[Scan]:
        return [self._convert(turn) for turn in self._turns.add(packet, sent) if not self._cut(not turn.whole)]

    def _convert(self, turn: lds03.Revolution) -> Scan:
        hertz = turn.rate or lds03.RATE
        self.rpm = 60.0 * hertz
        self.missing += not turn.whole
        rate = tau * hertz
        begun = _begun(turn.angles, turn.packets, turn.stamps, rate)
        ranges = np.where(turn.distances > 0, turn.distances * 1e-3, np.nan)
        angles = np.mod(-turn.angles, tau)
        return self._binned(begun, rate, angles, ranges, turn.intensities, (lds03.RANGE_MIN, lds03.RANGE_MAX))


def _begun(angles: F64, packets: NDArray[np.int32], stamps: I64, rate: float) -> int:
    """Return when a turn began [ns]: a packet sets out after its last point; the least late of them tells."""
    last = np.zeros(len(stamps))
    np.maximum.at(last, packets, angles)
    return int((stamps - np.rint(last / rate * 1e9).astype(np.int64)).min())


def make(name: str, config: Config) -> Model:
    """Return the stream of a model: "lds01", "lds02" or "lds03"."""
    models: dict[str, Callable[[Config], Model]] = {"lds01": Lds01, "lds02": Lds02, "lds03": Lds03}
    return models[name](config)
