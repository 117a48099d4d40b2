"""`experiment depth-single`: three controllers of one point (Fig. 9.4, 9.5), and a moving goal (Fig. 9.6)."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from knotwork.core.messages import F64
from knotwork.plugins.commands.experiment import figures
from knotwork.plugins.commands.experiment.parts import write_json
from knotwork.plugins.commands.experiment.single_runs import CIRCLE, K_CHI, VARIANTS, figures_of, single

_COLOURS = dict(zip(VARIANTS, ("tab:red", "tab:blue", "tab:green"), strict=True))


class DepthSingle:
    """Deterministic: --runs, --seed and --jobs change nothing."""

    def arguments(self, parser: Any) -> None:
        """Add nothing."""

    def run(self, arguments: Any) -> int:
        """Run, write results.json and figures, print a table."""
        out = Path(arguments.out)
        out.mkdir(parents=True, exist_ok=True)
        still = {name: single(name) for name in VARIANTS}
        moving = {
            "with feed-forward": single("varying-depth", circle=CIRCLE),
            "without": single("varying-depth", circle=CIRCLE, feed_forward=False),
        }
        # Algorithm 9 with the smaller root at each sample, as printed, and with the root nearest to the last one, at
        # half the critical gain, where the difference is plain.
        rules = {
            "as printed": single("varying-depth", k_chi=0.5 * K_CHI, printed=True),
            "nearest root": single("varying-depth", k_chi=0.5 * K_CHI),
        }
        results = {
            "goal stands": {name: figures_of(run) for name, run in still.items()},
            "goal on a circle": {name: figures_of(run) for name, run in moving.items()},
            "Algorithm 9, half gain": {name: figures_of(run) for name, run in rules.items()},
        }
        write_json(out / "results.json", results)
        if not arguments.no_figures:
            _still(out, still)
            _image(out, still)
            _moving(out, moving)
            _rules(out, rules)
        sys.stdout.write(json.dumps(results, indent=1) + "\n" if arguments.json else _table(results))
        return 0


def _still(out: Path, runs: dict[str, dict[str, F64]]) -> None:
    figure, axes = figures.subplots(2, 2, figsize=(10, 6.5))
    panels: tuple[tuple[str, Callable[[dict[str, F64]], F64], float], ...] = (
        ("error of inverse depth [1/m]", lambda r: r["chi"] - r["chi_hat"], 3.0),
        ("image error", lambda r: r["error"], 10.0),
        ("sigma² [m²/s²]", lambda r: r["sigma2"], 10.0),
        ("J_l w [1/s]", lambda r: r["J_l w"], 10.0),
    )
    for axis, (name, value, end) in zip(axes.flat, panels, strict=True):
        for variant, run in runs.items():
            axis.plot(run["time"], value(run), label=variant, color=_COLOURS[variant])
        axis.set_xlim(0.0, end)
        figures.label(axis, "time [s]", name)
    axes[1, 0].set_ylim(0.0, 0.012)
    axes[1, 1].axhline(0.0, color="0.6", linewidth=0.8)
    axes[0, 0].legend()
    figures.save(figure, out, "fig-9.4-single-point")


def _image(out: Path, runs: dict[str, dict[str, F64]]) -> None:
    figure, axes = figures.subplots(1, 2, figsize=(10, 4))
    for variant, run in runs.items():
        axes[0].plot(run["x"], run["y"], label=variant, color=_COLOURS[variant])
        axes[0].plot(run["goal_x"][-1], run["goal_y"][-1], "x", color=_COLOURS[variant])
        axes[1].plot(run["time"], 1.0 / run["chi"], label=variant, color=_COLOURS[variant])
    axes[0].set_aspect("equal", adjustable="datalim")
    axes[0].invert_yaxis()
    axes[0].legend()
    figures.label(axes[0], "x", "y (down)", "path in the image, x: goal")
    figures.label(axes[1], "time [s]", "depth [m]")
    figures.save(figure, out, "fig-9.5-image-and-depth")


def _moving(out: Path, runs: dict[str, dict[str, F64]]) -> None:
    figure, axes = figures.subplots(1, 3, figsize=(13, 4))
    for (name, run), colour in zip(runs.items(), ("tab:blue", "tab:orange"), strict=True):
        axes[0].plot(run["x"], run["y"], label=name, color=colour)
        axes[1].plot(run["time"], run["error"], label=name, color=colour)
        axes[2].plot(run["time"], run["chi"] - run["chi_hat"], label=name, color=colour)
    axes[0].plot(run["goal_x"], run["goal_y"], ":", color="0.3", label="goal")
    axes[0].set_aspect("equal", adjustable="datalim")
    axes[0].invert_yaxis()
    axes[0].legend()
    axes[2].set_xlim(0.0, 3.0)
    figures.label(axes[0], "x", "y (down)")
    figures.label(axes[1], "time [s]", "image error")
    figures.label(axes[2], "time [s]", "error of inverse depth [1/m]")
    figures.save(figure, out, "fig-9.6-moving-goal")


def _rules(out: Path, runs: dict[str, dict[str, F64]]) -> None:
    figure, axes = figures.subplots(1, 2, figsize=(10, 3.6))
    for (name, run), colour in zip(runs.items(), ("tab:red", "tab:blue"), strict=True):
        axes[0].plot(run["time"], run["chi"] - run["chi_hat"], label=name, color=colour)
        late = run["time"] >= 18.0
        axes[1].plot(run["time"][late], run["v_x"][late], label=name, color=colour)
    axes[0].axhline(0.0, color="0.6", linewidth=0.8)
    axes[0].legend()
    figures.label(axes[0], "time [s]", "error of inverse depth [1/m]", "half the critical gain")
    figures.label(axes[1], "time [s]", "v_x [m/s]", "the last two seconds")
    figures.save(figure, out, "algorithm-9")


def _table(results: dict[str, dict[str, dict[str, Any]]]) -> str:
    lines = [
        "                   < 0.05   < 0.01   sigma^2         J_l w                   flips  |e| late  |depth e.| late"
    ]
    for scene, rows in results.items():
        lines.append(scene)
        for name, row in rows.items():
            times = [("-" if t is None else f"{t:.2f} s") for t in (row["t_0.05_s"], row["t_0.01_s"])]
            lines.append(
                f"  {name:<17}{times[0]:>7}{times[1]:>9}   {row['sigma2_min']:.4f}-{row['sigma2_max']:.4f}"
                f"   {row['J_l_w_min']:+.1e} .. {row['J_l_w_max']:+.1e}  {row['flips']:>5}"
                f"  {row['error_steady']:.1e}  {row['depth_error_tail']:.1e}"
            )
    return "\n".join(lines) + "\n"
