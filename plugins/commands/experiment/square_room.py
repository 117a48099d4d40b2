"""`experiment square-room`: mapping error against the side of a square room (Fig. 7.5 and 7.6)."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from knotwork.core.contracts import Map
from knotwork.core.messages import F64
from knotwork.core.world.raycast import RayCaster
from knotwork.core.world.scene import World, box
from knotwork.plugins.commands.experiment import figures
from knotwork.plugins.commands.experiment.bare_map import (
    CENTRE,
    COLOURS,
    available,
    build_map,
    distances,
    fused_as,
    turn,
)
from knotwork.plugins.commands.experiment.map_error import pose_error, range_errors, residual_error
from knotwork.plugins.commands.experiment.parts import Part, run_parts, write_json

SIDES = tuple(round(4.0 + 0.02 * i, 2) for i in range(10))  # m
MAPS = ("surface", "textbook", "nearest", "bilinear", "bicubic", "tsdf")
STEP = 0.10  # m, knot interval or cell side
FREE = 0.1  # log-odds; a hit is 1
BEAMS, RANGE_MAX = 360, 3.5  # LDS-01
GRIDS = ("textbook", "nearest", "bilinear", "bicubic")
KEYS = ("residual", "pose_m", "range_m")
TITLES = (
    ("residual", 1.0, 5, "mapping error (7.23)"),
    ("pose_m", 1e3, 2, "position after alignment, rms [mm]"),
    ("range_m", 1e3, 2, "ridge off the wall, rms [mm]"),
)
_MOST, _STILL = 500, 5  # scans; the map is stable after so many without a change
_WINDOW, _FINE = 0.2, 0.0025  # m


class SquareRoom:
    """Without noise: --runs and --seed change nothing."""

    runs = 1

    def arguments(self, parser: Any) -> None:
        """Add --free."""
        parser.add_argument(
            "--free",
            type=float,
            default=FREE,
            metavar="L",
            help=f"taken where a beam passes, all maps (default {FREE})",
        )

    def run(self, arguments: Any) -> int:
        """Run, write results.json and figures, print a table."""
        out = Path(arguments.out)
        maps = available(MAPS)
        kind = f"square-room-{arguments.free:g}"
        parts = [Part(kind, f"{side:.2f}", name, BEAMS, 0, 0, 1) for side in SIDES for name in maps]
        found = run_parts(parts, block, out / "parts", arguments.jobs)
        table = {name: [found[part] for part in parts if part.mode == name] for name in maps}
        results = {
            "sides_m": SIDES,
            "step_m": STEP,
            "free": arguments.free,
            "maps": table,
            "surface_below": below(table),
        }
        write_json(out / "results.json", results)
        if not arguments.no_figures:
            _curves(out, table)
            _pictures(out, maps, arguments.free)
        columns = [f"{side:.2f}" for side in SIDES]
        shown = text(results, "side [m]", columns, 9)
        sys.stdout.write(json.dumps(results, indent=1) + "\n" if arguments.json else shown)
        return 0


def ranges_in(side: float, pose: F64 = CENTRE) -> F64:
    """Return the distances [m] from a pose (3,) in a square room to its walls, a whole turn."""
    half = 0.5 * side
    return distances(RayCaster(World("room", box(-half, -half, half, half))), pose, BEAMS)


def mapped(name: str, side: float, free: float) -> tuple[Map, int]:
    """Return a map of the room that has been updated until it no longer changed, and how often that was."""
    chart = build_map(name, (STEP,), free=free)
    ranges = ranges_in(side)
    scan, pose = turn(ranges, RANGE_MAX), np.zeros(3)
    fused = fused_as(name, scan)
    before, still = np.inf, 0
    for count in range(1, _MOST + 1):
        for each in fused:
            chart.update(each, pose)
        now = float(np.abs(chart.alignment(scan, pose).residuals(pose, 0)[0]).sum())
        still = still + 1 if abs(now - before) < 1e-9 * (1.0 + now) else 0
        before = now
        if still == _STILL and count > 2 * _STILL:
            return chart, count
    return chart, _MOST


def block(part: Part) -> dict[str, Any]:
    """Return the errors of one map in one room."""
    side = float(part.disturbance)
    chart, scans = mapped(part.mode, side, float(part.setting.rpartition("-")[2]))
    errors = range_errors(chart, ranges_in(side), _WINDOW, _FINE)
    return {
        "side_m": side,
        "range_m": float(np.sqrt(np.mean(errors**2))),
        "pose_m": pose_error(chart, lambda pose: ranges_in(side, pose)),
        # A signed distance has no bound that means "nothing known".
        "residual": None if part.mode == "tsdf" else residual_error(chart, ranges_in(side)),
        "scans": scans,
    }


def below(table: dict[str, list[dict[str, Any]]]) -> dict[str, dict[str, list[bool]]]:
    """Say by measure and grid in which columns the surface's error is below the grid's."""
    grids = {name: rows for name, rows in table.items() if name in GRIDS}
    return {
        key: {
            name: [mine[key] < other[key] for mine, other in zip(table["surface"], rows, strict=True)]
            for name, rows in grids.items()
        }
        for key in KEYS
    }


def text(results: dict[str, Any], head: str, columns: list[str], width: int) -> str:
    """Return the table of the two rooms."""
    lines = [f"{head:<22}" + "".join(f"{column:>{width}}" for column in columns)]
    for key, scale, digits, title in TITLES:
        lines.append(title)
        for name, rows in results["maps"].items():
            if rows[0][key] is not None:
                cells = [f"{scale * row[key]:.{digits}f}" for row in rows]
                if f"{key}_std" in rows[0]:
                    spreads = (f" +- {scale * row[f'{key}_std']:.{digits}f}" for row in rows)
                    cells = [cell + spread for cell, spread in zip(cells, spreads, strict=True)]
                lines.append(f"  {name:<20}" + "".join(f"{cell:>{width}}" for cell in cells))
        for name, marks in results["surface_below"][key].items():
            cells = ["yes" if mark else "no" for mark in marks]
            lines.append(f"  {f'surface < {name}':<20}" + "".join(f"{cell:>{width}}" for cell in cells))
    return "\n".join(lines) + "\n"


def _curves(out: Path, table: dict[str, list[dict[str, Any]]]) -> None:
    figure, axes = figures.subplots(1, 3, figsize=(15, 4.2))
    for axis, (key, scale, _, title) in zip(axes, TITLES, strict=True):
        for name, rows in table.items():
            points = [(row["side_m"], scale * row[key]) for row in rows if row[key] is not None]
            if points:
                axis.plot(*zip(*points, strict=True), "o-", markersize=4, label=name, color=COLOURS[name])
        figures.label(axis, "side of the room [m]", title)
    finish(axes)
    figures.save(figure, out, "fig-7.6-square-room")


def finish(axes: Any) -> None:
    """Give the three panels of `TITLES` their scales and a legend of all maps; an error of 0 is not drawn."""
    axes[0].set_yscale("log")
    for axis in axes[1:]:
        axis.set_ylim(bottom=0.0)
    axes[1].legend()


def _pictures(out: Path, maps: tuple[str, ...], free: float, side: float = 4.10) -> None:
    """Draw a stretch of a wall half a cell off, in each map."""
    shown = [
        name for name in maps if name not in ("textbook", "bilinear", "bicubic")
    ]  # they store what `nearest` stores
    figure, axes = figures.subplots(1, len(shown), figsize=(4.2 * len(shown), 4), squeeze=False)
    x, y = np.meshgrid(np.arange(1.6, 2.4, 0.005), np.arange(-0.4, 0.4, 0.005))
    for axis, name in zip(axes[0], shown, strict=True):
        chart, _ = mapped(name, side, free)
        values = chart.occupancy(np.column_stack((x.ravel(), y.ravel()))).reshape(x.shape)
        axis.imshow(values, extent=(1.6, 2.4, -0.4, 0.4), origin="lower", cmap="gray_r", vmin=-1, vmax=1)
        axis.axvline(0.5 * side, color="tab:red", linewidth=1.2)
        figures.label(axis, "x [m]", "y [m]", f"{'grid' if name == 'nearest' else name}, wall at {0.5 * side:.2f} m")
        axis.grid(False)
    figures.save(figure, out, "fig-7.5-wall")
