"""Counts messages and writes what they and the runtime's statistics say as JSON."""

import json
import math
from typing import Any

from knotwork.core.contracts import Context, Sink
from knotwork.core.files import write_atomic
from knotwork.core.messages import UNSET, Event, Grid, Message, Pose, Scan, Statistics
from knotwork.plugins.sinks.summary import SummaryConfig
from knotwork.plugins.sinks.summary.truth_error import TruthError


class SummaryWriter(Sink):
    """Writes `summary.json` at the end and every so often; `complete` is true in the last one only.

    Lengths in m, times in s or ms as their keys say, memory in bytes. Where several nodes give poses or
    grids, path and lost scans are of the first one's, the map's bytes the sum over all.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._config: SummaryConfig = context.config
        self._scans = 0
        self._first = UNSET
        self._last = UNSET
        self._poses = ""  # the stream whose poses are counted
        self._at: tuple[float, float] | None = None
        self._path = 0.0
        self._lost = 0
        self._map_bytes: dict[str, int] = {}
        self._truth = TruthError()
        self._data: dict[str, Any] = {}
        self._complete = False
        self._written: int | None = None

    def on_message(self, stream: str, message: Message) -> None:
        """Count a message."""
        if isinstance(message, Statistics):
            self._data = message.data
            self._complete = message.final
            if message.final:
                self._write()
            return
        if isinstance(message, Scan):
            self._scans += 1
        elif isinstance(message, Pose):
            self._on_pose(stream, message)
        elif isinstance(message, Grid):
            self._map_bytes[stream] = message.map_bytes
        elif isinstance(message, Event):
            return  # may be older than the log's first measurement
        if self._first == UNSET:
            self._first = message.time
        self._last = max(self._last, message.time)
        if self._written is None:
            self._written = message.time
        elif self._config.period and message.time - self._written >= self._config.period * 1e9:
            self._written = message.time
            self._write()

    def close(self) -> None:
        """Write what is known, if the run's last statistics did not come."""
        if not self._complete:
            self._write()

    def _on_pose(self, stream: str, message: Pose) -> None:
        x, y, yaw = message.pose.tolist()
        if message.role == "truth" and message.scan_id >= 0:
            self._truth.add("truth", message.scan_id, (x, y, yaw))
        if message.role != "estimate" or message.scan_id < 0:
            return
        self._poses = self._poses or stream
        if stream != self._poses:
            return
        if message.lost:
            self._lost += 1
            return
        self._truth.add("estimate", message.scan_id, (x, y, yaw))
        if self._at is not None:
            self._path += math.hypot(x - self._at[0], y - self._at[1])
        self._at = (x, y)

    def _write(self) -> None:
        duration = (self._last - self._first) / 1e9
        wall = self._data.get("wall_s")
        nodes = self._data.get("nodes", {})
        summary = {
            "pipeline": self.context.run.get("pipeline"),
            "complete": self._complete,
            "scans": self._scans,
            "log_duration_s": duration,
            "wall_s": wall,
            "real_time_factor": duration / wall if wall else None,
            "path_length_m": self._path,
            "lost_scans": self._lost,
            "truth": self._truth.summary(),
            "map_bytes": sum(self._map_bytes.values()),
            "startup_s": self._data.get("startup_s"),
            "peak_rss_mb": self._data.get("peak_rss_mb"),
            "drops": sum(node.get("drops", 0) for node in nodes.values()),
            "nodes": nodes,
            "counters": self._data.get("counters", {}),
        }
        text = json.dumps(_plain(summary), indent=2, allow_nan=False, default=str) + "\n"
        write_atomic(self.context.out / f"{self._config.name}.json", text.encode())


def _plain(value: Any) -> Any:
    """Return what JSON can hold: no NaN or inf (null instead), no NumPy scalars."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
