"""`experiment timing`: what one scan costs to map and to align, each map at 5 cm (Table 7.1)."""

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from knotwork.core.messages import F64, Scan
from knotwork.plugins.commands.experiment import figures
from knotwork.plugins.commands.experiment.bare_map import COLOURS, available, build_map
from knotwork.plugins.commands.experiment.parts import write_json
from knotwork.plugins.commands.experiment.tours import scans_along

MAPS = ("surface", "nearest", "bilinear", "bicubic", "tsdf", "curve", "gp")
UNALIGNED = "gp"  # it maps only, and so slowly that a scan in so many must do:
SELDOM = {UNALIGNED: 50}
STEP = 0.05  # m
THESIS = {"occupancy grid": 5.94, "Fast-GPOM": 142.60, "B-spline surface": 1.13}  # ms, Table 7.1
_EVERY = 0.10  # m between scans


class MapTiming:
    """In one process, all maps in turn on each scan, so that what else the machine does hits all of them."""

    runs = 3

    def arguments(self, parser: Any) -> None:
        """Add --world."""
        parser.add_argument("--world", default="apartment", metavar="NAME", help="world with a path `tour`")

    def run(self, arguments: Any) -> int:
        """Run, write results.json and a figure, print a table; --jobs changes nothing."""
        out = Path(arguments.out)
        out.mkdir(parents=True, exist_ok=True)
        scans = scans_along(arguments.world, "tour", _EVERY, arguments.seed)
        maps = available(MAPS)
        rounds = [measured(maps, scans) for _ in range(arguments.runs)]
        table: dict[str, dict[str, Any]] = {
            name: {
                what: None if rounds[0][name][what] is None else float(np.median([one[name][what] for one in rounds]))
                for what in ("update_ms", "align_ms", "nbytes")
            }
            for name in maps
        }
        results = {
            "world": arguments.world,
            "scans": len(scans),
            "rounds": arguments.runs,
            "resolution_m": STEP,
            "maps": table,
            "update_relative_to_surface": {
                n: row["update_ms"] / table["surface"]["update_ms"] for n, row in table.items()
            },
            "thesis_ms": THESIS,
        }
        write_json(out / "results.json", results)
        if not arguments.no_figures:
            _bars(out, table)
        sys.stdout.write(json.dumps(results, indent=1) + "\n" if arguments.json else _text(results))
        return 0


def measured(maps: tuple[str, ...], scans: list[tuple[Scan, F64]]) -> dict[str, dict[str, Any]]:
    """Return processor time [ms] of an update and of one Gauss-Newton step (alignment and normal equations) a scan."""
    charts = {name: build_map(name, (STEP,)) for name in maps}
    update, align, counts = (dict.fromkeys(maps, 0) for _ in range(3))
    for number, (scan, pose) in enumerate(scans):
        for name, chart in charts.items():
            if number % SELDOM.get(name, 1):
                continue
            begun = time.process_time_ns()
            if name != UNALIGNED and not chart.empty():
                chart.alignment(scan, pose).normal_equations(pose, 0)
            between = time.process_time_ns()
            chart.update(scan, pose)
            update[name] += time.process_time_ns() - between
            align[name] += between - begun
            counts[name] += 1
    return {
        name: {
            "update_ms": update[name] / counts[name] / 1e6,
            "align_ms": None if name == UNALIGNED else align[name] / counts[name] / 1e6,
            "nbytes": float(chart.nbytes),
        }
        for name, chart in charts.items()
    }


def _bars(out: Path, table: dict[str, dict[str, Any]]) -> None:
    figure, axes = figures.subplots(1, 2, figsize=(11, 3.6))
    for axis, key, title in zip(axes, ("update_ms", "align_ms"), ("mapping", "one Gauss-Newton step"), strict=True):
        shown = {name: row[key] for name, row in table.items() if row[key] is not None}
        axis.barh(list(shown), list(shown.values()), color=[COLOURS[name] for name in shown])
        axis.set_xscale("log")
        axis.set_xlim(left=0.01)
        axis.invert_yaxis()
        figures.label(axis, "processor time a scan [ms]", "", title)
    figures.save(figure, out, "table-7.1-timing")


def _text(results: dict[str, Any]) -> str:
    lines = [f"{'map, 5 cm':<12}{'update ms':>12}{'x surface':>12}{'align ms':>12}{'bytes':>12}"]
    for name, row in results["maps"].items():
        ratio = results["update_relative_to_surface"][name]
        lines.append(
            f"{name:<12}{row['update_ms']:>12.3f}{ratio:>12.2f}{_number(row['align_ms']):>12}{row['nbytes']:>12,.0f}"
        )
    said = ", ".join(f"{name} {value}" for name, value in results["thesis_ms"].items())
    lines.append(
        f"{results['scans']} scans of {results['world']}, processor time, median of {results['rounds']} rounds"
    )
    return "\n".join([*lines, f"thesis, its machine [ms]: {said}"]) + "\n"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
