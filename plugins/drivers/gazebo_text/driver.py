"""Gazebo text lines to true poses and scans."""

from collections.abc import Sequence

import numpy as np

from knotwork.core.contracts import Context
from knotwork.core.log_driver import LogDriver
from knotwork.core.messages import Message, Odometry, Pose, Scan
from knotwork.plugins.drivers.gazebo_text import GazeboTextConfig


class GazeboTextDriver(LogDriver):
    """Streams the log; a malformed line still takes its 1 / rate of time."""

    expected = "lines of x y theta angle_min angle_max angle_increment and ranges"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._config: GazeboTextConfig = context.config
        self._record = 0

    def parse(self, line: bytes) -> Sequence[tuple[str, Message]]:
        """Return the messages of one line; raises ValueError for a malformed one."""
        fields = line.split()
        if not fields or fields[0].startswith(b"#"):
            return ()
        stamp = round(self._record * 1e9 / self._config.rate)
        self._record += 1
        try:
            values = np.array([float(text) for text in fields])
        except ValueError:
            raise ValueError("a field is not a number") from None
        if values.size < 7 or not np.isfinite(values[:6]).all():
            raise ValueError("expected a finite pose, three angles and ranges")
        angle_min, angle_max, increment = (float(value) for value in values[3:6])
        ranges = values[6:]
        if increment <= 0.0 or not abs(angle_min + (ranges.size - 1) * increment - angle_max) < 1.5 * increment:
            raise ValueError(f"{ranges.size} ranges do not fill the angles {angle_min:g} to {angle_max:g}")
        too_near = np.isnan(ranges) | (ranges < self._config.range_min)
        ranges = np.where(too_near, np.nan, np.where(ranges > self._config.range_max, np.inf, ranges))
        pose = values[:3].copy()
        messages: list[tuple[str, Message]] = [
            ("truth", Pose(stamp=stamp, role="truth", pose=pose, scan_id=self.scan_id))
        ]
        if self._config.odometry == "truth":
            messages.append(("odometry", Odometry(stamp=stamp, pose=pose)))
        scan = Scan(
            stamp=stamp,
            scan_id=self.scan_id,
            ranges=ranges.astype(np.float32),
            angle_min=angle_min,
            angle_increment=increment,
            range_min=self._config.range_min,
            range_max=self._config.range_max,
            mount=self._config.mount,
        )
        messages.append(("scan", scan))
        return messages
