"""`experiment curve-slam`: section 6.5, curves while following walls and while turning on the spot."""

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from knotwork.core.errors import InputError
from knotwork.core.messages import F64
from knotwork.core.world.files import load_world
from knotwork.plugins.commands.experiment import figures
from knotwork.plugins.commands.experiment.curve_runs import CELL, WORLD, Result, gallery_run
from knotwork.plugins.commands.experiment.parts import write_json

KNOTS = {"0.4": (0.4,), "0.2": (0.2,), "0.1": (0.1,), "pyramid": (0.4, 0.2, 0.1)}  # m


class CurveSlam:
    """Wall following and a full turn, at three knot intervals and all three."""

    def arguments(self, parser: Any) -> None:
        """Add what can be chosen."""
        parser.add_argument("--knots", nargs="+", choices=KNOTS, default=list(KNOTS), help="default: all")
        parser.add_argument(
            "--duration", type=float, default=400.0, metavar="S", help="of wall following, at most [s] (default 400)"
        )

    def run(self, arguments: Any) -> int:
        """Run, write results.json and the figure, print a table."""
        out = Path(arguments.out)
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot make the folder: {error.strerror}", where=str(out)) from error
        if arguments.duration <= 0.0:
            raise InputError("expected more than 0 s", where="--duration")
        walls: dict[str, Result] = {}
        results: dict[str, Any] = {}
        for name in arguments.knots:
            walls[name] = gallery_run(KNOTS[name], False, arguments.seed, arguments.duration)
            turn = gallery_run(KNOTS[name], True, arguments.seed, 60.0)
            results[name] = {"walls": scores(walls[name]), "turn": scores(turn)}
        write_json(out / "results.json", results)
        if not arguments.no_figures:
            _draw(out, walls)
        if arguments.json:
            sys.stdout.write(json.dumps(results, indent=1) + "\n")
        else:
            sys.stdout.write(_table(results))
        return 0


def scores(result: Result) -> dict[str, float]:
    """Return errors at the end of a run and the memory of its map."""
    n = min(len(result.poses), len(result.truths))
    error = result.poses[n - 1] - result.truths[n - 1]
    apart = np.hypot(*(result.poses[:n, :2] - result.truths[:n, :2]).T)
    stores = result.chart.stores
    points, curves = sum(len(store.control) for store in stores), sum(len(store) for store in stores)
    compact = 9 * points + 12 * curves
    return {
        "path_m": result.path,
        "scans": n,
        "lost_scans": result.lost,
        "end_translation_m": float(apart[-1]),
        "end_translation_percent_of_path": 100.0 * float(apart[-1]) / result.path if result.path > 1.0 else math.nan,
        "end_rotation_deg": abs(math.degrees(math.remainder(float(error[2]), 2.0 * math.pi))),
        "translation_rms_m": float(np.sqrt(np.mean(apart**2))),
        "curves": curves,
        "control_points": points,
        "map_bytes": compact,
        "map_nbytes": result.chart.nbytes,
        "grid_bytes": result.explored,
        "grid_over_map": result.explored / max(compact, 1),
        "grid_bytes_returns_only": result.explored_by_returns,
        "grid_over_map_returns_only": result.explored_by_returns / max(compact, 1),
    }


def _table(results: dict[str, Any]) -> str:
    lines = [
        f"world {WORLD}; the map's bytes are 9 a control point and 12 a curve, the grid's 1 a cell of {CELL} m",
        "knots      walls: path   end error   of path      rms   curves  points    map   grid  ratio"
        "    turn: rotation error",
    ]
    for name, row in results.items():
        w, t = row["walls"], row["turn"]
        ends = f"{w['end_translation_m']:9.4f} m {w['end_translation_percent_of_path']:7.3f} %"
        size = f"{w['curves']:6.0f} {w['control_points']:7.0f} {w['map_bytes']:6.0f} {w['grid_bytes']:6.0f}"
        lines.append(
            f"{name:9s}{w['path_m']:10.1f} m {ends} {w['translation_rms_m']:7.4f} m {size} {w['grid_over_map']:6.1f}"
            f"    {t['end_rotation_deg']:9.3f} deg"
        )
    return "\n".join(lines) + "\n"


def _draw(out: Path, walls: dict[str, Result]) -> None:
    figure, axes = figures.subplots(1, len(walls), figsize=(6.0 * len(walls), 5.0), squeeze=False)
    world = load_world(WORLD)
    x, y, yaw = world.start
    c, s = math.cos(yaw), math.sin(yaw)
    for axis, (name, result) in zip(axes[0], walls.items(), strict=True):
        sweeps = [(a[:2] + a[2] * _unit(a[3] + a[4] * np.linspace(0.0, 1.0, 60))) for a in world.arcs]
        for wall in [part.reshape(2, 2) for part in world.segments] + sweeps:
            seen = (wall - (x, y)) @ np.array([[c, -s], [s, c]])
            axis.plot(seen[:, 0], seen[:, 1], color="0.85", linewidth=4)
        for line in result.chart.outlines():
            axis.plot(line[:, 0], line[:, 1], color="tab:blue", linewidth=1)
        axis.plot(result.truths[:, 0], result.truths[:, 1], color="0.5", linewidth=1, label="true path")
        axis.plot(result.poses[:, 0], result.poses[:, 1], "--", color="tab:red", linewidth=1, label="estimated path")
        axis.set_aspect("equal")
        figures.label(axis, "x [m]", "y [m]", f"knots {name}" + ("" if name == "pyramid" else " m"))
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figures.save(figure, out, "curve-slam")


def _unit(angle: F64) -> F64:
    return np.column_stack([np.cos(angle), np.sin(angle)])
