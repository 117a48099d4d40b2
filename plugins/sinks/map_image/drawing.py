"""The picture: grid in grey, path in colour, start and end marked, a scale bar."""

from collections.abc import Callable
from io import BytesIO
from math import ceil, cos, floor, log10, sin

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from knotwork.core.messages import F64, Grid

_PATH, _START, _END, _INK = (214, 69, 33), (20, 133, 88), (31, 90, 180), (40, 40, 40)
_UNKNOWN = 208  # grey
_FINE = 3  # overlay is drawn this much larger and reduced: smooth edges
_FAR = 1e9  # cells; a path beyond has diverged
_STRIP = 44  # px below the map for the scale bar


def draw(grid: Grid, path: F64, *, size: int, margin: float) -> bytes:
    """Return a PNG.

    Parameters
    ----------
    grid
        White is free, black occupied, grey unknown; up is +y of the grid's own axes.
    path : shape (n, 3)
        Robot poses x, y [m], yaw [rad] in the grid's frame, in order; lost ones left out.
    size
        Longer side of the map in the picture [px], roughly.
    margin
        Kept around the known cells and the path [m].
    """
    at = _in_grid(path[np.isfinite(path).all(axis=1)], grid.origin)
    low, high = _extent(grid.cells, at[:, :2] / grid.resolution, margin / grid.resolution)
    columns, rows = (high - low).tolist()
    scale = size / max(columns, rows)  # px per cell
    if scale > 1:
        scale = float(min(round(scale), 40))
    width, height = max(round(columns * scale), 120), max(round(rows * scale), 1)

    picture = Image.new("RGB", (width, height + _STRIP), "white")
    picture.paste((_UNKNOWN,) * 3, (0, 0, width, height))
    first, last = (np.clip(cell, 0, grid.cells.shape[::-1]) for cell in (low, high))
    part = grid.cells[first[1] : last[1], first[0] : last[0]]
    if part.size:
        background = _background(part, scale)
        left, bottom = ((first - low) * scale).round().astype(int).tolist()
        picture.paste(background, (left, height - bottom - background.height))
    picture.paste("white", (0, height, width, height + _STRIP))

    pixels = (at[:, :2] / grid.resolution - low) * scale
    pixels[:, 1] = height - pixels[:, 1]
    line = max(3.0, size / 500)
    if len(pixels):
        low_corner, high_corner = pixels.min(axis=0) - line, pixels.max(axis=0) + line
        _overlay(picture, _PATH, low_corner, high_corner, lambda pen, corner: _line(pen, pixels - corner, line))
        r, at_start = 3.2 * line, pixels[0]
        _overlay(picture, _START, at_start - r, at_start + r, lambda pen, corner: _disc(pen, at_start - corner, r))
        length, at_end, yaw = 5.5 * line, pixels[-1], float(at[-1, 2])
        _overlay(
            picture, _END, at_end - length, at_end + length,
            lambda pen, corner: _arrow(pen, at_end - corner, yaw, length),
        )  # fmt: skip
    _scale_bar(picture, scale / grid.resolution, height)
    out = BytesIO()
    picture.save(out, "PNG", compress_level=3)  # a third of the default's time, a tenth larger
    return out.getvalue()


def _overlay(
    picture: Image.Image,
    colour: tuple[int, int, int],
    low: F64,
    high: F64,
    shape: Callable[[ImageDraw.ImageDraw, F64], None],
) -> None:
    """Paint a shape that lies between two corners (2,) [px]; `shape` draws it seen from the corner it is given."""
    left, top = (max(0, floor(v)) for v in low.tolist())
    right, bottom = (min(most, ceil(v)) for v, most in zip(high.tolist(), picture.size, strict=True))
    if right <= left or bottom <= top:
        return
    mask = Image.new("L", ((right - left) * _FINE, (bottom - top) * _FINE))
    shape(ImageDraw.Draw(mask), np.array((left, top), np.float64))
    picture.paste(colour, (left, top), mask.resize((right - left, bottom - top), Image.Resampling.BOX))


def _in_grid(path: F64, origin: tuple[float, float, float]) -> F64:
    """Return poses (n, 3) of the grid's frame in the axes of its cells."""
    x, y, yaw = origin
    c, s = cos(yaw), sin(yaw)
    shifted = path[:, :2] - (x, y)
    return np.column_stack(
        [c * shifted[:, 0] + s * shifted[:, 1], -s * shifted[:, 0] + c * shifted[:, 1], path[:, 2] - yaw]
    )


def _extent(cells: NDArray[np.int8], points: F64, margin: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the cells (column, row) from and to which the picture goes, around all that is known."""
    known = cells >= 0
    columns, rows = np.flatnonzero(known.any(axis=0)), np.flatnonzero(known.any(axis=1))
    corners = [points]
    if len(columns):
        corners.append(np.array([[columns[0], rows[0]], [columns[-1] + 1, rows[-1] + 1]], np.float64))
    found = np.concatenate(corners)
    if not len(found):
        found = np.array([[0.0, 0.0], cells.shape[::-1]])
    low = np.floor(found.min(axis=0) - margin).clip(-_FAR, _FAR).astype(np.int64)
    high = np.ceil(found.max(axis=0) + margin).clip(-_FAR, _FAR).astype(np.int64)
    return low, np.maximum(high, low + 1)


def _background(cells: NDArray[np.int8], scale: float) -> Image.Image:
    """Return the cells as grey, the highest row first, `scale` pixels a cell."""
    table = np.full(256, _UNKNOWN, np.uint8)
    table[:101] = np.linspace(255, 0, 101).round()
    grey = table[np.ascontiguousarray(cells[::-1]).view(np.uint8)]
    rows, columns = (max(round(n * scale), 1) for n in cells.shape)
    return Image.fromarray(grey).resize(
        (columns, rows), Image.Resampling.NEAREST if scale >= 1 else Image.Resampling.BOX
    )


def _line(pen: ImageDraw.ImageDraw, pixels: F64, width: float) -> None:
    points = [(x * _FINE, y * _FINE) for x, y in pixels.tolist()]
    if len(points) > 1:
        pen.line(points, fill=255, width=round(width * _FINE), joint="curve")


def _disc(pen: ImageDraw.ImageDraw, at: F64, radius: float) -> None:
    x, y, r = at[0] * _FINE, at[1] * _FINE, radius * _FINE
    pen.ellipse((x - r, y - r, x + r, y + r), fill=255)


def _arrow(pen: ImageDraw.ImageDraw, at: F64, yaw: float, length: float) -> None:
    """Draw an arrow head that points where the robot looks; up is +y."""
    corners = []
    for turn, reach in ((0.0, 1.0), (2.45, 0.85), (np.pi, 0.35), (-2.45, 0.85)):
        x = at[0] + reach * length * cos(yaw + turn)
        y = at[1] - reach * length * sin(yaw + turn)
        corners.append((float(x) * _FINE, float(y) * _FINE))
    pen.polygon(corners, fill=255)


def _scale_bar(picture: Image.Image, pixels_per_metre: float, top: int) -> None:
    """Draw a bar of 1, 2 or 5 times a power of ten metres, and what the marks mean."""
    metres = _round_length(picture.width / 4 / pixels_per_metre)
    pen, y, x = ImageDraw.Draw(picture), top + _STRIP / 2, 14.0
    end = x + metres * pixels_per_metre
    pen.line([(x, y - 5), (x, y), (end, y), (end, y - 5)], fill=_INK, width=2)
    font = ImageFont.load_default(15)
    pen.text((end + 10, y), f"{metres:g} m", fill=_INK, font=font, anchor="lm")
    right = picture.width - 14.0
    for text, colour in (("end", _END), ("start", _START)):
        if right > end + 130:
            pen.text((right, y), text, fill=colour, font=font, anchor="rm")
            right -= pen.textlength(text, font=font) + 16


def _round_length(length: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above `length`."""
    power = 10.0 ** floor(log10(length))
    return max(step * power for step in (1, 2, 5) if step * power <= length or step == 1)
