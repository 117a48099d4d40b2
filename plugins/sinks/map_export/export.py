"""Occupancy grid to the files of ROS `map_server` and Nav2, mode trinary."""

import numpy as np
from numpy.typing import NDArray

from knotwork.core.contracts import Context, Sink
from knotwork.core.errors import KnotworkError
from knotwork.core.files import write_atomic
from knotwork.core.messages import Grid, Message
from knotwork.plugins.sinks.map_export import MapExportConfig

_FREE, _OCCUPIED, _UNKNOWN = 254, 0, 205  # grey values as map_saver writes them


class MapExport(Sink):
    """Keeps the last grid of each stream and writes it at the end, and each period if there is one."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._config: MapExportConfig = context.config
        self._grids: dict[str, Grid] = {}
        self._names: dict[str, str] = {}
        self._written: dict[str, int] = {}

    def on_message(self, stream: str, message: Message) -> None:
        """Keep a grid."""
        if not isinstance(message, Grid):
            return
        if stream not in self._names:
            suffix = "-" + stream.replace(".", "-") if self._names else ""
            self._names[stream] = self._config.name + suffix
            self._written[stream] = message.time
        self._grids[stream] = message
        period = self._config.period
        if period and message.time - self._written[stream] >= period * 1e9:
            self._written[stream] = message.time
            self._write(stream)

    def close(self) -> None:
        """Write the last grids."""
        if not self._grids:
            self.context.report("warning", f"{self._config.name}.pgm is not written: no grid came")
        for stream in self._grids:
            self._write(stream)

    def _write(self, stream: str) -> None:
        grid, name, config = self._grids[stream], self._names[stream], self._config
        try:
            image = pgm(grid.cells, config.free_thresh, config.occupied_thresh)
            write_atomic(self.context.out / f"{name}.pgm", image)
            text = map_yaml(grid, f"{name}.pgm", config.free_thresh, config.occupied_thresh)
            write_atomic(self.context.out / f"{name}.yaml", text.encode())
        except KnotworkError as error:
            self.context.report("error", str(error))


def pgm(cells: NDArray[np.int8], free_thresh: float, occupied_thresh: float) -> bytes:
    """Return a binary PGM (P5) of `cells` (rows, cols) as in `messages.Grid`, the highest y in its first row.

    A reader takes (255 - grey) / 255 as the probability of occupied and compares it with the
    thresholds; each grey value is chosen so that it reads back as what the cell is.
    """
    unknown = _UNKNOWN
    if not free_thresh < (255 - unknown) / 255 < occupied_thresh:
        unknown = round(255 * (1 - (free_thresh + occupied_thresh) / 2))
    grey = np.full(cells.shape, unknown, np.uint8)
    known = cells >= 0
    grey[known & (cells < 100 * free_thresh)] = _FREE if free_thresh > 1 / 255 else 255
    grey[known & (cells > 100 * occupied_thresh)] = _OCCUPIED
    rows, columns = cells.shape
    return f"P5\n{columns} {rows}\n255\n".encode() + grey[::-1].tobytes()


def map_yaml(grid: Grid, image: str, free_thresh: float, occupied_thresh: float) -> str:
    """Return the text of the YAML file beside the image `image`."""
    origin = ", ".join(_number(value) for value in grid.origin)
    return (
        f"image: {image}\n"
        "mode: trinary\n"
        f"resolution: {_number(grid.resolution)}\n"
        f"origin: [{origin}]\n"
        "negate: 0\n"
        f"occupied_thresh: {_number(occupied_thresh)}\n"
        f"free_thresh: {_number(free_thresh)}\n"
    )


def _number(value: float) -> str:
    """Write a float without an exponent, which YAML 1.1 readers take for text (`1e-05`)."""
    return np.format_float_positional(value, trim="0")
