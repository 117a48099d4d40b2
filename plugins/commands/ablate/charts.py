"""Charts as inline SVG: cumulative errors, bars, paths, maps. No library: the report must stand alone."""

import base64
import io
from dataclasses import dataclass
from html import escape
from math import ceil, floor, log10

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from knotwork.core.messages import F64

COLOURS = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f3c8d", "#a5aa99", "#e73f74", "#4b4b4b",
)  # fmt: skip
_QUANTILES = np.linspace(0.0, 1.0, 201)
_POINTS = 1500  # of a path that are drawn, at most
_PIXELS = 900  # longer side of a map's picture
_UNKNOWN = 215  # grey

Box = tuple[float, float, float, float]  # x0, y0, x1, y1 [m]
GridCells = tuple[NDArray[np.int8], float, tuple[float, float, float]]


@dataclass(frozen=True, slots=True)
class Series:
    """Numbers of one run, with its name and colour."""

    name: str
    colour: str
    values: F64


def cumulative(series: list[Series], label: str) -> str:
    """Return which share of errors is below x, x logarithmic; series of errors [m], shape (n,)."""
    series = [one for one in series if one.values.size]
    if not series:
        return ""
    low = min(float(np.quantile(one.values, 0.05)) for one in series)
    high = max(float(one.values.max()) for one in series)
    first, last = floor(log10(max(low, 1e-5))), ceil(log10(max(high, 2e-5)))
    last = max(last, first + 1)
    width, height, left, bottom = 560, 300, 44, 40

    def x_of(value: float) -> float:
        return left + (width - left - 12) * (log10(max(value, 10.0**first)) - first) / (last - first)

    def y_of(share: float) -> float:
        return 10 + (height - bottom - 10) * (1.0 - share)

    parts = []
    for power in range(first, last + 1):
        for step in (1, 2, 5):
            value = step * 10.0**power
            if value > 10.0**last * 1.001:
                continue
            x = x_of(value)
            parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="10" y2="{height - bottom}" class="g"/>')
            if step == 1 or last - first < 4:
                parts.append(f'<text x="{x:.1f}" y="{height - bottom + 14}" class="m">{value:g}</text>')
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        y = y_of(share)
        parts.append(f'<line x1="{left}" x2="{width - 12}" y1="{y:.1f}" y2="{y:.1f}" class="g"/>')
        parts.append(f'<text x="{left - 6}" y="{y + 4:.1f}" class="e">{100 * share:.0f} %</text>')
    for one in series:
        at = np.quantile(one.values, _QUANTILES)
        points = " ".join(f"{x_of(float(v)):.1f},{y_of(float(q)):.1f}" for v, q in zip(at, _QUANTILES, strict=True))
        title = f"{one.name}: median {np.median(one.values):.4f} m, 95 % below {np.quantile(one.values, 0.95):.4f} m"
        parts.append(f'<polyline points="{points}" class="l" stroke="{one.colour}"><title>{escape(title)}</title>')
        parts.append("</polyline>")
    parts.append(f'<text x="{(left + width) / 2}" y="{height - 6}" class="m">{escape(label)}</text>')
    return _svg(width, height, parts)


def bars(rows: list[tuple[str, str, list[float]]], unit: str, parts_of: tuple[str, ...] = ()) -> str:
    """Return horizontal bars; a row is name, colour and the lengths of its parts, which are stacked."""
    total = max((sum(values) for _, _, values in rows), default=0.0)
    if not rows or total <= 0.0:
        return ""
    width, left, right, step = 560, 170, 90, 22
    parts = []
    for index, (name, colour, values) in enumerate(rows):
        y, x = 6 + index * step, float(left)
        parts.append(f'<text x="{left - 8}" y="{y + 13}" class="e">{escape(_cut(name))}</text>')
        for number, value in enumerate(values):
            length = (width - left - right) * value / total
            opacity = 1.0 - 0.55 * number / max(len(values) - 1, 1)
            what = f"{parts_of[number]} " if parts_of else ""
            parts.append(
                f'<rect x="{x:.1f}" y="{y}" width="{length:.1f}" height="{step - 5}" fill="{colour}" '
                f'fill-opacity="{opacity:.2f}"><title>{escape(what)}{value:.4g} {escape(unit)}</title></rect>'
            )
            x += length
        parts.append(f'<text x="{x + 6:.1f}" y="{y + 13}">{sum(values):,.4g} {escape(unit)}</text>')
    return _svg(width, 12 + step * len(rows), parts)


def paths(series: list[Series]) -> str:
    """Return paths on top of each other; series of poses, shape (n, 3)."""
    series = [one for one in series if len(one.values)]
    if not series:
        return ""
    box = common_box([_path_box(one.values) for one in series])
    parts = [_path(one, box) for one in series]
    x0, y0, x1, y1 = _padded(box)
    return _plan(_padded(box), "".join(parts) + _scale_bar((x0, y0, x1, y1)))


def chart_of_map(grid: GridCells | None, path: Series | None, box: Box) -> str:
    """Return a map with the path on it, the part of the plane inside `box`."""
    inner = ""
    if grid is not None and grid[0].size:
        x0, y0, x1, y1 = grid_box(grid)
        inner += (
            f'<image href="data:image/png;base64,{base64.b64encode(_png(grid[0])).decode()}" x="{x0:.3f}" '
            f'y="{-y1:.3f}" width="{x1 - x0:.3f}" height="{y1 - y0:.3f}" preserveAspectRatio="none" class="map"/>'
        )
    if path is not None and len(path.values):
        inner += _path(path, box)
    return _plan(box, inner + _scale_bar(box))


def grid_box(grid: GridCells) -> Box:
    """Return what a grid covers [m]; grids of maps are not turned."""
    cells, resolution, (x, y, _) = grid
    return x, y, x + resolution * cells.shape[1], y + resolution * cells.shape[0]


def common_box(boxes: list[Box]) -> Box:
    """Return the box around all of them."""
    low = np.min([box[:2] for box in boxes], axis=0)
    high = np.max([box[2:] for box in boxes], axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _path_box(poses: F64) -> Box:
    low, high = poses[:, :2].min(axis=0), poses[:, :2].max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _padded(box: Box) -> Box:
    room = max(0.04 * max(box[2] - box[0], box[3] - box[1]), 0.1)
    return box[0] - room, box[1] - room, box[2] + room, box[3] + room


def _path(one: Series, box: Box) -> str:
    stride = max(1, len(one.values) // _POINTS)
    points = " ".join(f"{x:.2f},{-y:.2f}" for x, y in one.values[::stride, :2].tolist())
    thin = max(box[2] - box[0], box[3] - box[1]) / 350
    return (
        f'<polyline points="{points}" fill="none" stroke="{one.colour}" stroke-width="{thin:.3f}" '
        f'stroke-linejoin="round" stroke-opacity="0.85"><title>{escape(one.name)}</title></polyline>'
    )


def _plan(box: Box, inner: str) -> str:
    x0, y0, x1, y1 = box
    return f'<svg viewBox="{x0:.3f} {-y1:.3f} {x1 - x0:.3f} {y1 - y0:.3f}" class="plan">{inner}</svg>'


def _scale_bar(box: Box) -> str:
    x0, y0, x1, y1 = box
    size = max(x1 - x0, y1 - y0)
    power = 10.0 ** floor(log10(max(size / 5, 1e-9)))
    metres = max(step * power for step in (1, 2, 5) if step * power <= size / 5)
    x, y, thick = x0 + 0.03 * size, -y0 - 0.03 * size, size / 250
    return (
        f'<path d="M{x:.3f} {y:.3f}h{metres:.3f}" stroke="#222" stroke-width="{thick:.3f}"/>'
        f'<text x="{x:.3f}" y="{y - 2 * thick:.3f}" font-size="{size / 28:.3f}">{metres:g} m</text>'
    )


def _png(cells: NDArray[np.int8]) -> bytes:
    """Return cells as grey, the highest row first: white free, black occupied."""
    table = np.full(256, _UNKNOWN, np.uint8)
    table[:101] = np.linspace(255, 0, 101).round()
    picture = Image.fromarray(table[np.ascontiguousarray(cells[::-1]).view(np.uint8)])
    scale = _PIXELS / max(picture.size)
    if scale < 1:
        width, height = (max(1, round(side * scale)) for side in picture.size)
        picture = picture.resize((width, height), Image.Resampling.BOX)
    out = io.BytesIO()
    picture.save(out, "PNG", optimize=True)
    return out.getvalue()


def _cut(name: str) -> str:
    return name if len(name) <= 26 else name[:25] + "…"


def _svg(width: int, height: int, parts: list[str]) -> str:
    return f'<svg viewBox="0 0 {width} {height}" class="chart">{"".join(parts)}</svg>'
