"""`experiment circular-room`: mapping error against the noise of the sensor (Fig. 7.7 and 7.8)."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from knotwork.core.contracts import Map
from knotwork.core.messages import F64
from knotwork.core.world.raycast import RayCaster
from knotwork.core.world.scene import World
from knotwork.plugins.commands.experiment import figures
from knotwork.plugins.commands.experiment.bare_map import CENTRE, COLOURS, available, build_map, distances, turn
from knotwork.plugins.commands.experiment.map_error import pose_error, range_errors, residual_error
from knotwork.plugins.commands.experiment.parts import Part, run_parts, write_json
from knotwork.plugins.commands.experiment.square_room import TITLES, below, finish, text

NOISES = (0.025, 0.05, 0.075, 0.1)  # m
MAPS = ("surface", "nearest", "bilinear", "bicubic", "tsdf")
RADIUS, STEP, SCANS = 2.0, 0.10, 500
BEAMS, RANGE_MAX = 360, 3.5  # LDS-01
_BLOCK = 3  # runs a part
_WINDOW, _FINE = 0.5, 0.01  # m
_HITS = 10  # a scan that a place of the surface can take at most: all beams within two knots; a cell takes one


class CircularRoom:
    """A sensor at rest in the middle of a circular room."""

    runs = 33

    def arguments(self, parser: Any) -> None:
        """Add --scans and --clamp."""
        parser.add_argument("--scans", type=int, default=SCANS, metavar="N", help=f"of each map (default {SCANS})")
        parser.add_argument(
            "--clamp",
            type=float,
            default=0.0,
            metavar="L",
            help="bound of log-odds of all maps (default: none reaches it)",
        )

    def run(self, arguments: Any) -> int:
        """Run, write results.json and figures, print a table."""
        out = Path(arguments.out)
        maps = available(MAPS)
        clamp = arguments.clamp
        parts = [
            Part(f"circular-room-{clamp:g}", f"{noise}", name, arguments.scans, arguments.seed, first, count)
            for noise in NOISES
            for name in maps
            for first in range(0, arguments.runs, _BLOCK)
            if (count := min(_BLOCK, arguments.runs - first))
        ]
        found = run_parts(parts, block, out / "parts", arguments.jobs)
        table = {
            name: [
                summary([row for p in parts if (p.mode, p.disturbance) == (name, f"{noise}") for row in found[p]])
                for noise in NOISES
            ]
            for name in maps
        }
        results = {
            "noise_m": NOISES,
            "runs": arguments.runs,
            "scans": arguments.scans,
            "clamp": clamp or "not reached",
            "maps": table,
            "surface_below": below(table),
        }
        write_json(out / "results.json", results)
        if not arguments.no_figures:
            _curves(out, table)
            _pictures(out, maps, arguments.scans, clamp, arguments.seed)
        columns = [str(noise) for noise in NOISES]
        shown = text(results, "noise [m]", columns, 20)
        sys.stdout.write(json.dumps(results, indent=1) + "\n" if arguments.json else shown)
        return 0


def ranges_in(pose: F64 = CENTRE) -> F64:
    """Return the distances [m] from a pose (3,) in the room to its wall, a whole turn."""
    circle = np.array([[0.0, 0.0, RADIUS, 0.0, 2.0 * np.pi]])
    return distances(RayCaster(World("room", np.empty((0, 4)), circle)), pose, BEAMS)


def off_centre(found: F64, true: F64) -> float:
    """Return by how much [m] a pose (3,) is wrong about the distance from the middle: all that the room can tell."""
    return float(np.hypot(*found[:2]) - np.hypot(*true[:2]))


def mapped(name: str, noise: float, scans: int, clamp: float, seed: int, run: int) -> Map:
    """Return a map of the room after so many noisy scans; every map gets the same ones in the same run."""
    random = np.random.default_rng((seed, run, round(1e6 * noise)))
    bound = clamp or scans * (_HITS if name == "surface" else 1)
    chart, true, pose = build_map(name, (STEP,), clamp=bound), ranges_in(), np.zeros(3)
    for _ in range(scans):
        chart.update(turn(true + noise * random.standard_normal(len(true)), RANGE_MAX), pose)
    return chart


def block(part: Part) -> list[dict[str, Any]]:
    """Return the errors of one map at one noise, a row a run."""
    rows = []
    clamp = float(part.setting.rpartition("-")[2])
    for run in range(part.first, part.first + part.count):
        chart = mapped(part.mode, float(part.disturbance), part.n, clamp, part.seed, run)
        errors = range_errors(chart, ranges_in(), _WINDOW, _FINE)
        residual = None if part.mode == "tsdf" else residual_error(chart, ranges_in(), _WINDOW, _FINE)
        found = {"residual": residual, "pose_m": pose_error(chart, ranges_in, off_centre)}
        rows.append(found | {"range_m": float(np.sqrt(np.mean(errors**2)))})
    return rows


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return mean and standard deviation over runs of each figure."""
    result: dict[str, Any] = {"runs": len(rows)}
    for key in rows[0]:
        values = [row[key] for row in rows if row[key] is not None]
        result[key] = float(np.mean(values)) if values else None
        result[f"{key}_std"] = float(np.std(values)) if values else None
    return result


def _curves(out: Path, table: dict[str, list[dict[str, Any]]]) -> None:
    figure, axes = figures.subplots(1, 3, figsize=(15, 4.2))
    for axis, (key, scale, _, title) in zip(axes, TITLES, strict=True):
        for name, rows in table.items():
            if rows[0][key] is not None:
                mean, spread = ([scale * row[end] for row in rows] for end in (key, f"{key}_std"))
                axis.errorbar(
                    NOISES, mean, spread, marker="o", markersize=4, capsize=3, label=name, color=COLOURS[name]
                )
        figures.label(axis, "standard deviation of the ranges [m]", title)
    finish(axes)
    figures.save(figure, out, "fig-7.8-circular-room")


def _pictures(out: Path, maps: tuple[str, ...], scans: int, clamp: float, seed: int) -> None:
    shown = [name for name in maps if name not in ("bilinear", "bicubic")]  # they store what `nearest` stores
    figure, axes = figures.subplots(2, len(shown), figsize=(4.2 * len(shown), 8), squeeze=False)
    x, y = np.meshgrid(np.arange(-2.6, 2.6, 0.02), np.arange(-2.6, 2.6, 0.02))
    angles = np.linspace(0.0, 2.0 * np.pi, 400)
    for row, noise in zip(axes, (NOISES[0], NOISES[-1]), strict=True):
        for axis, name in zip(row, shown, strict=True):
            chart = mapped(name, noise, scans, clamp, seed, 0)
            values = chart.occupancy(np.column_stack((x.ravel(), y.ravel()))).reshape(x.shape)
            axis.imshow(values, extent=(-2.6, 2.6, -2.6, 2.6), origin="lower", cmap="gray_r", vmin=-1, vmax=1)
            axis.plot(RADIUS * np.cos(angles), RADIUS * np.sin(angles), color="tab:red", linewidth=0.8)
            figures.label(axis, "x [m]", "y [m]", f"{'grid' if name == 'nearest' else name}, noise {noise} m")
            axis.grid(False)
    figures.save(figure, out, "fig-7.7-circular-room-maps")
