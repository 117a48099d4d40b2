"""`experiment corridor-memory`: what a map of a corridor takes (section 6.5), and of a furnished apartment."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from knotwork.core.contracts import Map
from knotwork.plugins.commands.experiment import figures
from knotwork.plugins.commands.experiment.bare_map import available, build_map
from knotwork.plugins.commands.experiment.parts import Part, run_parts, write_json
from knotwork.plugins.commands.experiment.tours import scans_along

WORLDS = {"corridor-300m": 0.25, "apartment": 0.10}  # m between scans
LEVELS = {
    "grid 0.05": ("nearest", (0.05,)),
    "grid 0.30 0.125 0.05": ("nearest", (0.30, 0.125, 0.05)),
    "tsdf 0.05": ("tsdf", (0.05,)),
    "surface 0.05": ("surface", (0.05,)),
    "surface 0.30 0.125 0.05": ("surface", (0.30, 0.125, 0.05)),
    "curve 0.4 0.2 0.1": ("curve", (0.4, 0.2, 0.1)),
}
_CONTROL_POINT, _KNOT_VECTOR = 9, 12  # bytes, as section 6.5 counts
_CELL = 0.05  # m


class CorridorMemory:
    """Maps along a path at exact poses: --runs changes nothing."""

    runs = 1

    def arguments(self, parser: Any) -> None:
        """Add --length."""
        parser.add_argument(
            "--length", type=float, default=0.0, metavar="M", help="use so much of each path only (default: all)"
        )

    def run(self, arguments: Any) -> int:
        """Run, write results.json and a figure, print a table."""
        out = Path(arguments.out)
        usable = available(tuple({name for name, _ in LEVELS.values()}))
        chosen = [label for label, (name, _) in LEVELS.items() if name in usable]
        cut = round(1e3 * arguments.length)
        parts = [Part(world, label, "memory", cut, arguments.seed, 0, 1) for world in WORLDS for label in chosen]
        found = run_parts(parts, block, out / "parts", arguments.jobs)
        worlds = {world: {p.disturbance: found[p] for p in parts if p.setting == world} for world in WORLDS}
        results = {world: compared(rows) for world, rows in worlds.items()}
        write_json(out / "results.json", results)
        if not arguments.no_figures:
            _bars(out, results)
        sys.stdout.write(json.dumps(results, indent=1) + "\n" if arguments.json else _text(results))
        return 0


def block(part: Part) -> dict[str, Any]:
    """Return what one map takes of one world."""
    name, resolution = LEVELS[part.disturbance]
    chart = build_map(name, resolution)
    step = WORLDS[part.setting]
    scans = scans_along(part.setting, "tour", step, part.seed)
    for scan, pose in scans[: round(part.n / 1e3 / step) or None]:
        chart.update(scan, pose)
    return {"nbytes": chart.nbytes, **_counted(chart, name)}


def _counted(chart: Map, name: str) -> dict[str, Any]:
    """Return what the thesis counts: cells that have been explored, or control points and curves."""
    if name == "curve":
        counts = chart.statistics()
        points, curves = int(counts["control_points"]), int(counts["curves"])
        thesis = _CONTROL_POINT * points + _KNOT_VECTOR * curves
        return {"control_points": points, "curves": curves, "thesis_bytes": thesis}
    cells = int((chart.rasterize(_CELL)[0] >= 0).sum())
    return {"explored_cells": cells, "thesis_bytes": cells if name == "nearest" else None}


def compared(rows: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Add how many times smaller each map is than the 5 cm grid, really and as the thesis counts."""
    grid = rows.get("grid 0.05")
    for row in rows.values():
        row["grid_ratio"] = grid["nbytes"] / row["nbytes"] if grid else None
        counted = row["thesis_bytes"] if "curves" in row else None
        row["thesis_ratio"] = grid["thesis_bytes"] / counted if grid and counted else None
    return rows


def _bars(out: Path, results: dict[str, dict[str, dict[str, Any]]]) -> None:
    figure, axes = figures.subplots(1, len(results), figsize=(6 * len(results), 3.6), squeeze=False)
    for axis, (world, rows) in zip(axes[0], results.items(), strict=True):
        at = np.arange(len(rows))
        axis.barh(at - 0.2, [row["nbytes"] / 1e3 for row in rows.values()], 0.38, label="in memory")
        counted = [(row["thesis_bytes"] or 0) / 1e3 for row in rows.values()]
        axis.barh(at + 0.2, counted, 0.38, label="as section 6.5 counts")
        axis.set_yticks(at, list(rows))
        axis.set_xscale("log")
        axis.set_xlim(left=1.0)
        axis.invert_yaxis()
        figures.label(axis, "kB", "", world)
    axes[0][0].legend()
    figures.save(figure, out, "memory")


def _text(results: dict[str, dict[str, dict[str, Any]]]) -> str:
    lines = []
    for world, rows in results.items():
        lines.append(f"{world:<28}{'bytes':>14}{'grid/this':>11}{'section 6.5':>14}{'grid/this':>11}")
        for label, row in rows.items():
            cells = [f"{row['nbytes']:,}", *(_ratio(row["grid_ratio"]),)]
            cells += [f"{row['thesis_bytes']:,}" if row["thesis_bytes"] else "-", _ratio(row["thesis_ratio"])]
            widths = zip(cells, (14, 11, 14, 11), strict=True)
            lines.append(f"  {label:<26}" + "".join(f"{cell:>{width}}" for cell, width in widths))
    return "\n".join(lines) + "\n"


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
