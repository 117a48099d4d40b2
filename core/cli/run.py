"""`knotwork run FILE`: run a pipeline to its end, a signal or a failure."""

import argparse
import json
import os
import platform
import signal
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from knotwork.core import config
from knotwork.core.cli import pipeline_file
from knotwork.core.cli.console import Console, table
from knotwork.core.errors import InputError
from knotwork.core.registry import Registry

if TYPE_CHECKING:
    from knotwork.core.config import Pipeline
    from knotwork.core.runtime import Result, Run

_VERSIONS_OF = ("knotwork", "numpy", "numba", "scipy", "mcap", "pydantic")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add FILE, --set, --out, --rate, --json."""
    pipeline_file.add_arguments(parser)
    parser.add_argument("--out", metavar="DIR", help="folder for what the run writes (default runs/PIPELINE/TIME)")
    parser.add_argument("--rate", metavar="max|N", help="speed of a log relative to its sensors (default max)")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON on standard output")
    parser.add_argument("--quiet", action="store_true", help="only warnings and errors")


def run(arguments: argparse.Namespace) -> int:
    """Run it; returns 0 done, 1 failed, 2 wrong input."""
    registry = Registry()
    pipeline, wired = pipeline_file.load(arguments, registry)
    rate = _rate(arguments.rate, pipeline)
    out = Path(arguments.out) if arguments.out else _default_folder(pipeline.name)

    from knotwork.core.runtime import Run

    console = Console(quiet=arguments.quiet or arguments.json)
    execution = Run(
        pipeline, wired, registry, out, rate=rate, console=console.report, header=header(pipeline, registry)
    )
    console.follow(execution)
    _on_signals(execution, console)
    try:
        result = execution.execute()
    finally:
        console.close()
    _keep(out, pipeline, console, result)
    if result.failure is not None:
        for line in str(result.failure).splitlines():
            sys.stderr.write(f"knotwork: {line}\n")
    if arguments.json:
        sys.stdout.write(json.dumps(_as_json(pipeline, out, result), indent=2) + "\n")
    elif not arguments.quiet and result.statistics["nodes"]:
        sys.stdout.write(table(result.statistics))
        sys.stdout.write(f"{out}: {', '.join(sorted(p.name for p in out.iterdir()))}\n")
    return result.exit_code


def _rate(text: str | None, pipeline: "Pipeline") -> float | None:
    value = pipeline.rate if text is None else text
    if value in ("max", None):
        return None
    try:
        rate = float(value)
    except ValueError:
        rate = 0.0
    if not 0 < rate < float("inf"):
        raise InputError(f"expected `max` or a number above 0, got {value!r}", where="--rate")
    return rate


def _default_folder(name: str) -> Path:
    base = Path("runs") / name
    stamp = time.strftime("%Y%m%d-%H%M%S")
    folder = next(f for f in (base / (stamp + s) for s in ("", *(f"-{i}" for i in range(2, 100)))) if not f.exists())
    base.mkdir(parents=True, exist_ok=True)
    latest = base / "latest"
    if latest.is_symlink() or not latest.exists():
        latest.unlink(missing_ok=True)
        latest.symlink_to(folder.name)
    return folder


def header(pipeline: "Pipeline", registry: Registry) -> dict[str, Any]:
    """Return what a log must say of the run that wrote it."""
    versions = {"python": platform.python_version(), "machine": platform.machine()}
    for name in _VERSIONS_OF:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    records = {name: registry.record(node.plugin) for name, node in pipeline.nodes.items()}
    return {
        "pipeline": pipeline.name,
        "seed": pipeline.seed,
        "config": config.show(pipeline),
        "versions": versions,
        "plugins": {name: f"{r.name} ({r.distribution})" for name, r in records.items() if r is not None},
        "external": [name for name, node in pipeline.nodes.items() if node.manifest.external],
    }


def _on_signals(execution: "Run", console: Console) -> None:
    """First SIGINT or SIGTERM: a graceful stop. Second: motion stops, then the process ends at once."""
    seen: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        seen.append(number)
        name = signal.Signals(number).name
        if len(seen) == 1:
            console.line(f"{name}: stopping (once more to stop at once)")
            execution.stop(name)
            return
        execution.stop_motion()
        os._exit(128 + number)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handle)


def _keep(out: Path, pipeline: "Pipeline", console: Console, result: "Result") -> None:
    """Write config.yaml and run.log beside what the sinks wrote."""
    if not out.is_dir():
        return
    try:
        (out / "config.yaml").write_text(config.show(pipeline))
        failure = f"failed: {result.failure}\n{result.trace}" if result.failure else "done\n"
        (out / "run.log").write_text("".join(f"{line}\n" for line in console.kept) + failure)
    except OSError as error:
        sys.stderr.write(f"knotwork: {out}: cannot write config.yaml and run.log: {error.strerror}\n")


def _as_json(pipeline: "Pipeline", out: Path, result: "Result") -> dict[str, Any]:
    summary = out / "summary.json"
    return {
        "pipeline": pipeline.name,
        "out": str(out),
        "exit_code": result.exit_code,
        "failure": str(result.failure) if result.failure else None,
        "summary": json.loads(summary.read_text()) if summary.is_file() else None,
        "statistics": result.statistics,
    }
