"""Runs the shipped pipeline `demo.yaml` and says where the map is and how good it is."""

import argparse
import json
import sys
from pathlib import Path

from knotwork.core.cli.main import main
from knotwork.core.contracts import Command

_FILE = "configs:demo.yaml"


class Demo(Command):
    """The first thing a newcomer runs."""

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add --out and --set."""
        parser.add_argument(
            "--out", metavar="DIR", default="runs/demo", help="folder for the results (default runs/demo)"
        )
        parser.add_argument(
            "--set",
            dest="overrides",
            metavar="KEY=VALUE",
            action="append",
            default=[],
            help="override one value of the pipeline",
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Run it; returns the run's exit code."""
        out = Path(arguments.out)
        sys.stderr.write("A simulated TurtleBot3 maps an apartment (lidar range bias switched off).\n")
        overrides = [part for value in arguments.overrides for part in ("--set", value)]
        code = main(["run", _FILE, "--out", str(out), *overrides])
        summary = out / "summary.json"
        if code == 0 and summary.is_file():
            sys.stdout.write(_closing_lines(out, json.loads(summary.read_text())))
        return code


def _closing_lines(out: Path, summary: dict[str, object]) -> str:
    truth = summary.get("truth")
    error = "no truth to compare with"
    if isinstance(truth, dict):
        error = (
            f"position error {100 * truth['position_rms_m']:.1f} cm RMS, {100 * truth['position_max_m']:.1f} cm at most; "
            f"heading {truth['heading_rms_deg']:.2f} deg RMS"
        )
    return (
        f"\nmap picture: {out / 'map.png'}\nlog:         {out / 'log.mcap'}\n"
        f"measured:    {summary['path_length_m']:.1f} m driven in {summary['log_duration_s']:.0f} s, "
        f"{summary['scans']} scans, {summary['real_time_factor']:.0f} x real time; {error}\n"
    )
