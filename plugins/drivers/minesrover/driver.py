"""Rover log lines to encoder odometry and scans."""

import math
from collections.abc import Sequence

import numpy as np

from knotwork.core.contracts import Context
from knotwork.core.log_driver import LogDriver
from knotwork.core.messages import F32, F64, Message, Odometry, Scan
from knotwork.plugins.drivers.minesrover import MinesroverConfig

_FIRST, _BEAMS = 24, 682  # columns of the ranges; one more column follows them
_COLUMNS = 707


class MinesroverDriver(LogDriver):
    """Streams the log; the first pose is the origin of `odom`."""

    expected = f"lines of {_COLUMNS} integers of the Paris Mines Tech rover"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._config: MinesroverConfig = context.config
        self._pose = (0.0, 0.0, 0.0)
        self._ticks: tuple[int, int] | None = None

    def parse(self, line: bytes) -> Sequence[tuple[str, Message]]:
        """Return the messages of one line; raises ValueError for a malformed one."""
        fields = line.split()
        if not fields or fields[0].startswith(b"#"):
            return ()
        if len(fields) != _COLUMNS:
            raise ValueError(f"expected {_COLUMNS} columns, found {len(fields)}")
        try:
            microseconds, left, right = int(fields[0]), int(fields[2]), int(fields[3])
            raw = np.array([int(text) for text in fields[_FIRST : _FIRST + _BEAMS]], dtype=np.float64)
        except (ValueError, OverflowError):
            raise ValueError("a field is not an integer") from None
        stamp = microseconds * 1000
        if abs(stamp) > 2**62 or max(abs(left), abs(right)) > 2**62:
            raise ValueError("a number is out of range")
        discontinuity = self._roll(left, right)
        scan = Scan(
            stamp=stamp,
            scan_id=self.scan_id,
            ranges=self._ranges(raw * 1e-3),
            angle_min=self._config.angle_min,
            angle_increment=self._config.angle_increment,
            range_min=self._config.range_min,
            range_max=self._config.range_max,
            mount=self._config.mount,
        )
        if not self._config.odometry:
            return (("scan", scan),)
        odometry = Odometry(stamp=stamp, pose=np.array(self._pose), discontinuity=discontinuity)
        return (("odometry", odometry), ("scan", scan))

    def _ranges(self, metres: F64) -> F32:
        out = np.where(metres > self._config.range_max, np.inf, metres).astype(np.float32)
        out[metres < self._config.range_min] = np.nan
        if self._config.zero == "no-return":
            out[metres == 0.0] = np.inf
        if self._config.margin:
            out[: self._config.margin] = np.nan
            out[-self._config.margin :] = np.nan
        return out

    def _roll(self, left: int, right: int) -> bool:
        # Differential drive along an arc: the chord points half the turn ahead.
        previous, self._ticks = self._ticks, (left, right)
        if previous is None:
            return False
        metres = math.tau * self._config.wheel_radius / self._config.ticks_per_turn
        dl, dr = (left - previous[0]) * metres, (right - previous[1]) * metres
        if max(abs(dl), abs(dr)) > self._config.largest_step:
            return True
        x, y, yaw = self._pose
        turn = (dr - dl) / self._config.axle
        chord = 0.5 * (dl + dr) * (math.sin(0.5 * turn) / (0.5 * turn) if turn else 1.0)
        self._pose = (
            x + chord * math.cos(yaw + 0.5 * turn),
            y + chord * math.sin(yaw + 0.5 * turn),
            math.remainder(yaw + turn, math.tau),
        )
        return False
