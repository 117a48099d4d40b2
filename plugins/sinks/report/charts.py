"""Drawings as SVG text, to stand in an HTML file."""

from collections.abc import Sequence
from math import cos, degrees, floor, log10, sin

import numpy as np

from knotwork.core.live.tiles import encode
from knotwork.core.messages import F64, Grid

COLOURS = ("#d64521", "#1f5ab4", "#8a5a00", "#7a2f9e")
TRUTH = "#148558"
_WIDTH, _HEIGHT = 960.0, 680.0  # px of the map
_LINE_WIDTH, _LINE_HEIGHT, _LEFT, _BOTTOM = 960.0, 190.0, 56.0, 24.0
_MOST = 1500  # points of a line


def plane(grids: Sequence[Grid], paths: Sequence[tuple[F64, str]]) -> str:
    """Return the map with paths over it; the first grid is drawn. Paths are (n, 2 or more) with their colours."""
    corners = [path[:, :2] for path, _ in paths if len(path)]
    grid = grids[0] if grids and grids[0].cells.size else None
    if grid is not None:
        corners.append(_corners(grid))
    if not corners:
        return "<p>There is no map and no path.</p>"
    points = np.concatenate(corners)
    low, high = points.min(axis=0) - 0.5, points.max(axis=0) + 0.5
    scale = float(min(_WIDTH / (high[0] - low[0]), _HEIGHT / (high[1] - low[1])))
    width, height = (high - low) * scale
    out = [f'<svg class="plane" viewBox="0 0 {width:.0f} {height + 30:.0f}" role="img" aria-label="map and paths">']
    out.append(f'<rect width="{width:.0f}" height="{height:.0f}" fill="#dfe1e6"/>')
    if grid is not None:
        rows, columns = grid.cells.shape
        x, y, yaw = grid.origin
        place = f"translate({(x - low[0]) * scale:.2f} {height - (y - low[1]) * scale:.2f}) rotate({-degrees(yaw):.4f})"
        w, h = columns * grid.resolution * scale, rows * grid.resolution * scale
        out.append(
            f'<image transform="{place}" y="{-h:.2f}" width="{w:.2f}" height="{h:.2f}" preserveAspectRatio="none" '
            f'style="image-rendering:pixelated" href="data:image/png;base64,{encode(grid.cells)}"/>'
        )
    for path, colour in paths:
        if not len(path):
            continue
        at = np.column_stack([(path[:, 0] - low[0]) * scale, height - (path[:, 1] - low[1]) * scale])
        out.append(f'<polyline points="{_points(at)}" fill="none" stroke="{colour}" stroke-width="2"/>')
        out.append(f'<circle cx="{at[0, 0]:.1f}" cy="{at[0, 1]:.1f}" r="5" fill="{colour}"/>')
    length = _round_length(float(width) / 4 / scale)
    out.append(
        f'<path d="M10 {height + 14:.0f}v6h{length * scale:.1f}v-6" fill="none" stroke="#222"/>'
        f'<text x="{length * scale + 18:.0f}" y="{height + 22:.0f}">{length:g} m</text></svg>'
    )
    return "".join(out)


def line(times: F64, values: Sequence[tuple[F64, str]], unit: str, name: str) -> str:
    """Return values (n,) over times (n,) [s], each with its colour."""
    if not len(times) or not any(len(each) for each, _ in values):
        return ""
    low = min(0.0, *(float(each.min()) for each, _ in values))
    high = max(float(each.max()) for each, _ in values)
    high = high if high > low else low + 1.0
    first, last = float(times.min()), float(times.max())
    last = last if last > first else first + 1.0
    wide, tall = _LINE_WIDTH - _LEFT - 8, _LINE_HEIGHT - _BOTTOM - 10
    out = [f'<svg class="line" viewBox="0 0 {_LINE_WIDTH:.0f} {_LINE_HEIGHT:.0f}" role="img" aria-label="{name}">']
    for value in _ticks(low, high, 4):
        y = 10 + tall * (1 - (value - low) / (high - low))
        out.append(f'<path d="M{_LEFT} {y:.1f}h{wide:.0f}" stroke="#e3e5ea"/>')
        out.append(f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
    for value in _ticks(first, last, 8):
        x = _LEFT + wide * (value - first) / (last - first)
        out.append(f'<text x="{x:.1f}" y="{_LINE_HEIGHT - 6}" text-anchor="middle">{value:g} s</text>')
    thin = slice(None, None, max(1, len(times) // _MOST))
    for each, colour in values:
        at = np.column_stack([
            _LEFT + wide * (times - first) / (last - first), 10 + tall * (1 - (each - low) / (high - low)),
        ])[thin]  # fmt: skip
        out.append(f'<polyline points="{_points(at)}" fill="none" stroke="{colour}" stroke-width="1.3"/>')
    out.append(f'<text x="{_LEFT + 6}" y="20" class="name">{name} [{unit}]</text></svg>')
    return "".join(out)


def histogram(buckets: Sequence[Sequence[float]], low: float, high: float) -> str:
    """Return bars of counts over durations on a logarithmic axis from `low` to `high` [ms].

    `buckets` are (upper end [ms], count), a quarter of an octave wide.
    """
    wide, tall = 220.0, 30.0
    octaves = max(np.log2(high / low), 1.0)
    most = max((count for _, count in buckets), default=1)
    bar = wide / octaves / 4
    out = [f'<svg class="bars" viewBox="0 0 {wide:.0f} {tall:.0f}" role="img" aria-label="histogram">']
    for upper, count in buckets:
        x = wide * (np.log2(max(upper, low) / low) / octaves) - bar
        h = max(tall * count / most, 1.0)
        out.append(f'<rect x="{x:.1f}" y="{tall - h:.1f}" width="{max(bar - 0.5, 0.8):.1f}" height="{h:.1f}"/>')
    return "".join([*out, "</svg>"])


def axis(low: float, high: float) -> str:
    """Return the axis that belongs to `histogram`: powers of ten [ms]."""
    wide = 220.0
    octaves = max(np.log2(high / low), 1.0)
    out = [f'<svg class="bars" viewBox="0 0 {wide:.0f} 14">']
    for power in range(int(np.ceil(log10(low))), floor(log10(high)) + 1):
        x = wide * np.log2(10.0**power / low) / octaves
        out.append(f'<text x="{x:.1f}" y="11" text-anchor="middle">{_duration(10.0**power)}</text>')
    return "".join([*out, "</svg>"])


def _duration(ms: float) -> str:
    if ms >= 1000:
        return f"{ms / 1000:g} s"
    return f"{ms:g} ms" if ms >= 1 else f"{ms * 1000:g} µs"


def _corners(grid: Grid) -> F64:
    rows, columns = grid.cells.shape
    x, y, yaw = grid.origin
    side = grid.resolution
    local = np.array([[0, 0], [columns, 0], [0, rows], [columns, rows]], np.float64) * side
    turn = np.array([[cos(yaw), sin(yaw)], [-sin(yaw), cos(yaw)]])
    return local @ turn + (x, y)  # type: ignore[no-any-return]


def _points(at: F64) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in at.tolist())


def _round_length(length: float) -> float:
    power = 10.0 ** floor(log10(length))
    return max(step * power for step in (1, 2, 5) if step * power <= length or step == 1)


def _ticks(low: float, high: float, about: int) -> list[float]:
    step = _round_length((high - low) / about) if high > low else 1.0
    first = int(np.ceil(low / step - 1e-9))
    return [round(k * step, 10) for k in range(first, floor(high / step + 1e-9) + 1)]
