"""`experiment depth-multi`: success of visual servoing with wrong initial depths (Fig. 9.7 to 9.9)."""

import json
import sys
from pathlib import Path
from typing import Any

from knotwork.core.errors import InputError
from knotwork.plugins.commands.experiment.parts import Part, run_parts, write_json
from knotwork.plugins.commands.experiment.scenarios import SETTINGS
from knotwork.plugins.commands.experiment.scoring import median, wilson
from knotwork.plugins.commands.experiment.servo_runs import DISTURBANCES, MODES, block

_BLOCK = 50  # scenarios of a part
_ROWS = ("ideal", "passive", "active", "active+", "ekf")


class DepthMulti:
    """Runs the modes on the same scenarios."""

    def arguments(self, parser: Any) -> None:
        """Add what can be chosen."""
        parser.add_argument(
            "--setting",
            choices=tuple(SETTINGS),
            default="B",
            help="guesses and gain: A, B, or the hard goal (default B)",
        )
        parser.add_argument("--points", type=int, nargs="+", default=[4, 5, 6, 7, 8, 9], metavar="N", help="4 or more")
        parser.add_argument(
            "--modes", nargs="+", choices=tuple(MODES), default=list(_ROWS), help="default: all but one"
        )
        parser.add_argument("--disturbance", choices=tuple(DISTURBANCES), default="none", help="default none")

    def run(self, arguments: Any) -> int:
        """Run, write results.json and figures, print a table."""
        if min(arguments.points) < 4:
            raise InputError(f"expected 4 or more, found {min(arguments.points)}", where="--points")
        out = Path(arguments.out)
        chosen, wrong, seed, runs_each = arguments.setting, arguments.disturbance, arguments.seed, arguments.runs
        parts = [
            Part(chosen, wrong, mode, n, seed, first, min(_BLOCK, runs_each - first))
            for mode in arguments.modes
            for n in arguments.points
            for first in range(0, runs_each, _BLOCK)
        ]
        results = run_parts(parts, block, out / "parts", arguments.jobs)
        runs: dict[int, dict[str, list[dict[str, Any]]]] = {
            n: {m: [] for m in arguments.modes} for n in arguments.points
        }
        for part in parts:
            runs[part.n][part.mode].extend(results[part])
        summary = {chosen: {str(n): summarise(modes) for n, modes in runs.items()}}
        write_json(out / "results.json", summary)
        write_json(out / "passive-only.json", {str(n): passive_only(modes) for n, modes in runs.items()})
        if not arguments.no_figures:
            from knotwork.plugins.commands.experiment import multi_figures

            multi_figures.draw(out, chosen, wrong, seed, runs, summary[chosen])
        sys.stdout.write(json.dumps(summary, indent=1) + "\n" if arguments.json else _table(summary[chosen]))
        return 0


def summarise(modes: dict[str, list[dict[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Return success with its 95 % interval, median depth error, median extra time over the ideal run, of each mode.

    Depth errors are of the scenarios that the passive mode solves (if it ran), extra times of those that the
    mode and the ideal one solve.
    """
    out = {}
    for mode, runs in modes.items():
        wins = sum(run["success"] for run in runs)
        low, high = wilson(wins, len(runs))
        reference = modes.get("passive", runs)
        ideal = modes.get("ideal", [])
        depth_errors = [
            run["depth_error_m"]
            for run, other in zip(runs, reference, strict=True)
            if other["success"] and run["depth_error_m"] is not None
        ]
        extra = [
            run["settled_s"] - best["settled_s"]
            for run, best in zip(runs, ideal, strict=False)
            if run["success"] and best["success"]
        ]
        out[mode] = {
            "runs": len(runs),
            "success": wins / len(runs),
            "ci_low": low,
            "ci_high": high,
            "depth_error_median_m": median(depth_errors),
            "extra_time_median_s": median(extra),
            "failed_solves": sum(run["failed_solves"] for run in runs),
        }
    return out


def passive_only(modes: dict[str, list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Return the scenarios that the passive mode solves and the active one does not, and why not."""
    out = []
    for index, (passive, active) in enumerate(zip(modes.get("passive", []), modes.get("active", []), strict=False)):
        if passive["success"] and not active["success"]:
            why = "a point came too near"
            if active["error"] is not None and active["phase"] < 3:
                why = (
                    "depths still uncertain, camera nearly still"
                    if active["speed"] < 0.01
                    else "depths still uncertain"
                )
            elif active["error"] is not None:
                why = "released, not there yet" if active["speed"] >= 0.002 else "released, stuck"
            out.append({"scenario": index, "why": why, "error": active["error"], "speed": active["speed"]})
    return out


def _table(summary: dict[str, dict[str, dict[str, Any]]]) -> str:
    lines = ["points  mode         success  95 % interval   depth error (median)  extra time (median)"]
    for n, modes in summary.items():
        for mode, row in modes.items():
            depth = "-" if row["depth_error_median_m"] is None else f"{row['depth_error_median_m']:.2g} m"
            extra = "-" if row["extra_time_median_s"] is None else f"{row['extra_time_median_s']:+.2f} s"
            interval = f"{row['ci_low']:.3f} .. {row['ci_high']:.3f}"
            lines.append(f"{n:>6}  {mode:<11}  {row['success']:.3f}    {interval}  {depth:>20}  {extra:>19}")
    return "\n".join(lines) + "\n"
