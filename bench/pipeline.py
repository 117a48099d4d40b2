"""The whole pipeline of configs/radish.yaml on a log: where the time goes, logging, start-up.

    python bench/pipeline.py split LOG [--limit N]            processor time a scan, per node
    python bench/pipeline.py logging LOG [--rounds 2]         with and without the MCAP log, in turn
    python bench/pipeline.py startup LOG [--rounds 5] [--compile]   command to first scan; first run

On one core, or on those of `--cores 0 1`. Times are the processor's where they can be: a
busy machine stretches wall time at will.
"""

import argparse
import json
import lzma
import os
import resource
import sys
import tempfile
import time
from importlib.resources import files
from pathlib import Path
from subprocess import DEVNULL, Popen
from typing import Any
from unittest.mock import patch

import numpy as np

COMMAND = (sys.executable, "-m", "knotwork")


def split(log: Path, limit: int) -> None:
    """Run in this process with spans in thread time, which no other thread or program adds to."""
    from knotwork.core import config, graph
    from knotwork.core.registry import Registry
    from knotwork.core.runtime import Run
    from knotwork.core.runtime.timing import Clocked

    registry = Registry()
    pipeline = config.load("configs:radish.yaml", registry, [f"vars.log={log}", f"nodes.log.limit={limit}"])
    marks: list[tuple[float, float]] = []

    def mark() -> None:
        marks.append((time.process_time(), time.thread_time()))

    def dispatch(self: Run) -> None:
        mark()
        original(self)
        mark()

    original = Run._dispatch
    with (
        tempfile.TemporaryDirectory() as out,
        patch("knotwork.core.runtime.run.monotonic_clocked", lambda: Clocked(time.thread_time_ns)),
        patch("knotwork.core.runtime.assembly.monotonic_clocked", lambda: Clocked(time.thread_time_ns)),
        patch.object(Run, "_dispatch", dispatch),
    ):
        run = Run(pipeline, graph.build(pipeline), registry, Path(out))
        nodes = run.execute().statistics["nodes"]
    mark()
    (start, main_start), (end, main_end), (whole, _) = marks
    scans = nodes["localizer"]["n"]
    workers = {name for name, node in pipeline.nodes.items() if node.manifest.kind == "sink"}
    print(f"{scans} scans; start {start:.2f}, run {end - start:.2f}, end {whole - end:.2f} s of processor time")
    print(f"{'us a scan':<28}{'own':>8}{'a call':>10}{'calls':>9}")
    main = 0.0
    for name, row in nodes.items():
        if row["n"]:
            own = row["self_mean_ms"] * row["n"] / scans * 1e3
            main += own if name not in workers else 0.0
            print(f"{name:<28}{own:>8.1f}{row['mean_ms'] * 1e3:>10.1f}{row['n']:>9}")
    print(f"{'dispatcher and the rest':<28}{(main_end - main_start) / scans * 1e6 - main:>8.1f}")
    print(f"{'all threads':<28}{(end - start) / scans * 1e6:>8.1f}")


def timed(arguments: list[str], **environment: str) -> tuple[float, float]:
    """Return wall and processor time [s] of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begun = time.perf_counter()
    with Popen([*COMMAND, *arguments], stdout=DEVNULL, env=os.environ | environment) as process:
        code = process.wait()
    assert code == 0, f"{arguments} ended with {code}"
    wall = time.perf_counter() - begun
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def run_once(file: str, log: Path, out: str, *more: str, **environment: str) -> tuple[float, float, dict[str, Any]]:
    wall, cpu = timed(["run", file, "--set", f"vars.log={log}", "--out", out, "--quiet", *more], **environment)
    return wall, cpu, json.loads((Path(out) / "summary.json").read_text())


def logging(log: Path, limit: int, rounds: int) -> None:
    """Alternate runs with and without the recorder."""
    text = (files("knotwork.configs") / "radish.yaml").read_text()
    taken: dict[str, list[tuple[float, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        bare = Path(folder) / "bare.yaml"
        bare.write_text("".join(line for line in text.splitlines(True) if not line.startswith("  recorder:")))
        variants = {"with MCAP log": "configs:radish.yaml", "without": str(bare)}
        for _ in range(rounds):
            for name, file in variants.items():
                wall, cpu, summary = run_once(file, log, folder, "--set", f"nodes.log.limit={limit}")
                length = summary["log_duration_s"]
                if (recorded := Path(folder) / "log.mcap").exists():
                    size = recorded.stat().st_size / summary["nodes"]["localizer"]["n"]
                print(
                    f"{name:14} wall {wall:6.2f} s ({length / wall:4.0f} x), run alone {summary['wall_s']:6.2f} s "
                    f"({summary['real_time_factor']:4.0f} x), processor {cpu:6.2f} s ({length / cpu:4.0f} x)"
                )
                taken.setdefault(name, []).append((wall, cpu))
    logged, unlogged = (np.array(each) for each in taken.values())
    for name, ratio in (
        ("median of the rounds", np.median(logged / unlogged, axis=0)),
        ("fastest of each", logged.min(axis=0) / unlogged.min(axis=0)),
    ):
        wall, cpu = 100.0 * (ratio - 1.0)
        print(f"logging adds {cpu:.1f} % processor time, {wall:.1f} % wall ({name})")
    with lzma.open(log, "rt") as file:
        lines = [len(line) for line in file if line.startswith("FLASER")]
    print(f"{size:.0f} B a scan in the MCAP log, {sum(lines) / len(lines):.0f} B in the text log")


def startup(log: Path, rounds: int, compiling: bool) -> None:
    """Command to first scan, kernels cached; with `compiling` the first run of all, too."""
    with tempfile.TemporaryDirectory() as out:
        if compiling:
            with tempfile.TemporaryDirectory() as cache:
                wall, cpu, _ = run_once(
                    "configs:radish.yaml", log, out, "--set", "nodes.log.limit=2", NUMBA_CACHE_DIR=cache
                )
                print(f"first run, compiling: {wall:.1f} s, {cpu:.1f} s of processor time")
        for turn in range(rounds + 1):
            wall, cpu, summary = run_once("configs:radish.yaml", log, out, "--set", "nodes.log.limit=2")
            if turn:  # the first one may have compiled
                print(f"to the first scan {summary['startup_s']:.2f} s; to the end {wall:.2f} s, processor {cpu:.2f} s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("split", "logging", "startup"))
    parser.add_argument("log", type=Path)
    parser.add_argument("--limit", type=int, default=0, help="scans")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--cores", type=int, nargs="+", help="run on these cores only (default: the last one)")
    parser.add_argument("--compile", action="store_true")
    arguments = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, arguments.cores or {max(os.sched_getaffinity(0))})
    log = arguments.log.resolve()
    if arguments.what == "split":
        split(log, arguments.limit)
    elif arguments.what == "logging":
        logging(log, arguments.limit, arguments.rounds)
    else:
        startup(log, arguments.rounds, arguments.compile)


if __name__ == "__main__":
    main()
