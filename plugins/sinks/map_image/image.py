"""Keeps what the picture needs and draws it at the end."""

import numpy as np

from knotwork.core.contracts import Context, Sink
from knotwork.core.errors import KnotworkError
from knotwork.core.files import write_atomic
from knotwork.core.messages import F64, Grid, Message, Pose, Trajectory
from knotwork.plugins.sinks.map_image import MapImageConfig

_POSES = 8192  # of the path that is drawn; of a longer one every other pose is left out


class MapImage(Sink):
    """Keeps the last grid of each stream and the path; draws them at the end, and each period."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._config: MapImageConfig = context.config
        self._grids: dict[str, Grid] = {}
        self._names: dict[str, str] = {}
        self._drawn: dict[str, int] = {}
        self._path: dict[int, tuple[float, float, float]] = {}  # by scan, or by a negative number without one
        self._nameless = 0  # poses without a scan

    def on_message(self, stream: str, message: Message) -> None:
        """Keep a grid, a pose, the corrections of a trajectory."""
        if isinstance(message, Pose):
            if message.role == "estimate" and not message.lost:
                self._extend(message)
        elif isinstance(message, Trajectory):
            for scan, (x, y, yaw) in zip(message.scan_ids.tolist(), message.poses.tolist(), strict=True):
                if scan in self._path:
                    self._path[scan] = (x, y, yaw)
        elif isinstance(message, Grid):
            self._keep(stream, message)

    def close(self) -> None:
        """Draw the last grids."""
        if not self._grids:
            self.context.report("warning", f"{self._config.name}.png is not drawn: no grid came")
        for stream in self._grids:
            self._draw(stream)

    def _extend(self, pose: Pose) -> None:
        if pose.scan_id < 0:
            self._nameless += 1
        x, y, yaw = pose.pose.tolist()
        self._path[pose.scan_id if pose.scan_id >= 0 else -self._nameless] = (x, y, yaw)
        if len(self._path) > _POSES:
            newest = list(self._path.items())
            self._path = dict(newest[-1::-2][::-1])  # the last one stays: it marks the end

    def _keep(self, stream: str, grid: Grid) -> None:
        if stream not in self._names:
            suffix = "-" + stream.replace(".", "-") if self._names else ""
            self._names[stream] = self._config.name + suffix
            self._drawn[stream] = grid.time
        self._grids[stream] = grid
        period = self._config.period
        if period and grid.time - self._drawn[stream] >= period * 1e9:
            self._drawn[stream] = grid.time
            self._draw(stream)

    def _draw(self, stream: str) -> None:
        from knotwork.plugins.sinks.map_image.drawing import draw  # not while a run starts

        config, grid = self._config, self._grids[stream]
        path: F64 = np.array(list(self._path.values()) if config.trajectory else [], np.float64).reshape(-1, 3)
        try:
            picture = draw(grid, path, size=config.size, margin=config.margin)
            write_atomic(self.context.out / f"{self._names[stream]}.png", picture)
        except KnotworkError as error:
            self.context.report("error", str(error))
