"""What maps of the plane share: publishing, loading and saving, rasters."""

from abc import abstractmethod
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from knotwork.core.contracts import Context, Map
from knotwork.core.errors import InputError
from knotwork.core.map_config import MapConfig
from knotwork.core.map_file import Arrays, read_map, write_map
from knotwork.core.messages import F64, Grid

_FINEST = 0.05  # [m] cells of a raster are not smaller unless asked
_ROWS = 1 << 18  # cells evaluated at once


class PlaneMap(Map):
    """Base of maps whose config is a `MapConfig`; emits `grid` messages on its port `grid`.

    A subclass says what it stores (`stored`, `restore`), where it is known (`bounds`) and how occupied.
    """

    kind: ClassVar[str]  # the plugin's name, in its map files
    version: ClassVar[int] = 1  # of what it stores

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.config: MapConfig = context.config
        self.levels = len(self.config.resolution)
        if self.config.publish > 0:
            context.every(self.config.publish, self._publish)

    @abstractmethod
    def stored(self) -> tuple[dict[str, Any], Arrays]:
        """Return the facts and arrays a map file holds."""

    @abstractmethod
    def restore(self, facts: dict[str, Any], arrays: Arrays) -> None:
        """Replace the map by what `stored` returned; KeyError, ValueError and TypeError mean: no such map."""

    @abstractmethod
    def bounds(self) -> tuple[float, float, float, float]:
        """Return the box (x0, y0, x1, y1) [m] outside of which all is unknown."""

    def open(self) -> None:
        """Load the map file of the config, if it names one."""
        if self.config.load:
            self.load(Path(self.config.load))

    def finish(self) -> None:
        """Save the map if the config says so and publish it a last time."""
        if self.config.save:
            self.save(self.context.out / self.config.save)
        if not self.empty():
            self._emit(self.context.now(), final=True)

    def save(self, path: Path) -> None:
        """Write a map file; KnotworkError if it cannot be written."""
        facts, arrays = self.stored()
        own = {"config": self.config.model_dump(mode="json", exclude={"load", "save"})}
        if self.context.options is not None:
            own["options"] = self.context.options.model_dump(mode="json")
        write_map(path, self.kind, self.version, facts | own, arrays)

    def load(self, path: Path) -> None:
        """Replace the map by a file's.

        Raises
        ------
        InputError
            Missing, damaged, another plugin's, or made with other knots, cells or clamp than the config's.
        """
        facts, arrays = read_map(path, self.kind, self.version)
        try:
            resolution = [float(value) for value in facts["resolution"]]
            if not np.allclose(resolution, self.config.resolution, rtol=1e-12):
                raise InputError(
                    f"was made with resolution {resolution}, the config says {list(self.config.resolution)}",
                    where=str(path),
                    hint="set `resolution` of the map to that of the file",
                )
            if "clamp" in facts and not np.isclose(float(facts["clamp"]), self.config.clamp, rtol=1e-12):
                raise InputError(
                    f"was made with clamp {facts['clamp']}, the config says {self.config.clamp}",
                    where=str(path),
                    hint="set `clamp` of the map to that of the file",
                )
            self.restore(facts, arrays)
        except (KeyError, ValueError, TypeError, IndexError) as error:
            raise InputError(f"is not a whole {self.kind} map ({error})", where=str(path)) from error

    def rasterize(self, resolution: float | None = None) -> tuple[NDArray[np.int8], float, tuple[float, float, float]]:
        """Return cells, resolution and origin as in `messages.Grid`; occupancy is taken at cell centres.

        Cells are as large as the finest level's unless `resolution` [m] is given, but at least 5 cm.
        """
        cell = resolution or max(self.config.resolution[-1], _FINEST)
        x0, y0, x1, y1 = self.bounds()
        i0, j0 = (int(np.floor(v / cell)) for v in (x0, y0))
        i1, j1 = (int(np.ceil(v / cell)) for v in (x1, y1))
        columns, rows = i1 - i0, j1 - j0
        cells = np.full((max(rows, 0), max(columns, 0)), -1, np.int8)
        if rows <= 0 or columns <= 0:
            return cells, cell, (0.0, 0.0, 0.0)
        centres = (np.arange(i0, i1) + 0.5) * cell
        step = max(1, _ROWS // columns)
        for start in range(0, rows, step):
            stop = min(start + step, rows)
            points = np.empty((stop - start, columns, 2))
            points[..., 0] = centres
            points[..., 1] = ((np.arange(start, stop) + j0 + 0.5) * cell)[:, None]
            cells[start:stop] = to_percent(self.occupancy(points.reshape(-1, 2))).reshape(-1, columns)
        known_rows, known_columns = (np.flatnonzero((cells >= 0).any(axis=axis)) for axis in (1, 0))
        if not len(known_rows):
            return cells[:0, :0], cell, (0.0, 0.0, 0.0)
        a, b = int(known_rows[0]), int(known_columns[0])
        known = np.ascontiguousarray(cells[a : known_rows[-1] + 1, b : known_columns[-1] + 1])
        return known, cell, ((i0 + b) * cell, (j0 + a) * cell, 0.0)

    def _publish(self, time: int) -> None:
        if not self.empty():
            self._emit(time, final=False)

    def _emit(self, time: int, *, final: bool) -> None:
        with self.context.measure("publish"):
            cells, resolution, origin = self.rasterize()
        grid = Grid(stamp=time, cells=cells, resolution=resolution, origin=origin, map_bytes=self.nbytes, final=final)
        self.context.emit("grid", grid)


def to_percent(occupancy: F64) -> NDArray[np.int8]:
    """Return occupancy in [-1, 1] as cells of a `Grid`: percent, -1 where it is 0 (unknown)."""
    percent = np.rint(50.0 * (1.0 + occupancy)).astype(np.int8)
    percent[np.abs(occupancy) < 1e-6] = -1
    return percent
