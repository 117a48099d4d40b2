"""`experiment depth-gains`: the observer at half, once and twice the critically damped gain (Fig. 9.3)."""

import json
import sys
from pathlib import Path
from typing import Any

from knotwork.plugins.commands.experiment import figures
from knotwork.plugins.commands.experiment.parts import write_json
from knotwork.plugins.commands.experiment.single_runs import K_CHI, figures_of, single


class DepthGains:
    """Deterministic: --runs, --seed and --jobs change nothing."""

    def arguments(self, parser: Any) -> None:
        """Add nothing."""

    def run(self, arguments: Any) -> int:
        """Run, write results.json and the figure, print a table."""
        out = Path(arguments.out)
        out.mkdir(parents=True, exist_ok=True)
        runs = {
            f"x{factor:g}": single("varying-depth", k_chi=factor * K_CHI, duration=4.0) for factor in (0.5, 1.0, 2.0)
        }
        results = {name: figures_of(run) for name, run in runs.items()}
        write_json(out / "results.json", results)
        if not arguments.no_figures:
            figure, axis = figures.subplots(figsize=(6, 4))
            for name, run in runs.items():
                axis.plot(run["time"], run["chi"] - run["chi_hat"], label=f"gain {name}")
            axis.axhline(0.0, color="0.6", linewidth=0.8)
            figures.label(axis, "time [s]", "error of inverse depth [1/m]")
            axis.legend()
            figures.save(figure, out, "fig-9.3-gains")
        if arguments.json:
            sys.stdout.write(json.dumps(results, indent=1) + "\n")
        else:
            sys.stdout.write("gain   < 0.05 from  < 0.01 from  overshoot\n")
            for name, row in results.items():
                times = (("-" if t is None else f"{t:.2f} s") for t in (row["t_0.05_s"], row["t_0.01_s"]))
                sys.stdout.write(f"{name:<5}  {next(times):>11}  {next(times):>11}  {row['overshoot']:>9.4f}\n")
        return 0
