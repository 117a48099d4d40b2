"""B-spline libraries side by side: the thesis's Tables 4.1, 4.2, Figs 4.6, 4.7, and this machine's bounds.

    pip install -e '.[bench]'
    python bench/splines.py --out runs/bench-splines      (some minutes; --quick: one)

Every library gets the same control points (cubic, knot interval 0.05) and the same points, results are
allocated in the call and compared. In each round every library is timed once, so that a busy machine
slows all of them; the figure is the lowest of the rounds' medians.
"""

import argparse
import json
import logging
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from spline_bounds import bandwidth, flops
from spline_peers import Knotwork, KnotworkSingle, Library, Thesis, installed

STEP = 0.05
SIZES = (180, 360, 1040, 10_000, 100_000)
TASKS = {
    "curve": "(a) curve (Table 4.1)",
    "surface": "(b) surface (Table 4.1)",
    "curve_d": "(c) curve and derivative (Table 4.2)",
    "surface_d": "(d) surface and both partial derivatives (Table 4.2)",
}
SIDES = (1, 10, 100)  # m; maps of 1, 100, 10 000 m^2
Table = dict[str, list[float | None]]  # microseconds a call by library; None: not measured


def median_call(function, argument, budget: float) -> float:
    """Return the median time [s] of a call within about `budget` [s], at least one call."""
    times, spent = [], 0.0
    while (spent < budget or len(times) < 3) and not (times and spent > 20 * budget):
        start = time.perf_counter()
        function(argument)
        times.append(time.perf_counter() - start)
        spent += times[-1]
    return float(np.median(times))


def race(calls: dict[str, tuple], budget: float, rounds: int) -> dict[str, float]:
    """Return the lowest median [s] of each `(function, argument)`, all of them timed in turn.

    Calls far over the budget sit out all rounds but two.
    """
    best = dict.fromkeys(calls, np.inf)
    for turn in range(rounds):
        for name, (function, argument) in calls.items():
            if turn > 1 and best[name] > 5 * budget:
                continue
            best[name] = min(best[name], median_call(function, argument, budget))
    return best


def agree(name: str, ours, theirs, tolerance: float) -> None:
    """Stop if a library computes something else: times would mean nothing."""
    for a, b in zip(ours, theirs, strict=True):
        worst = float(np.abs(np.asarray(a) - np.asarray(b)).max() / np.abs(a).max())
        if not worst < tolerance:
            sys.exit(f"{name} disagrees by {worst:.1e} of the largest value")


def parts(result):
    return result if isinstance(result, tuple) else (result,)


def tables(libraries: list[type[Library]], sizes, budget: float, rounds: int, limit: float) -> dict[str, Table]:
    """Time the four tasks at all sizes; a library whose call would take over `limit` [s] sits out."""
    rng = np.random.default_rng(42)
    count = round(10 / STEP) + 3
    origin = -3 * STEP
    controls = {"curve": np.cumsum(rng.normal(size=(count, 2)), axis=0), "surface": rng.normal(size=(count, count))}
    out: dict[str, Table] = {}
    for task in TASKS:
        control = controls[task.removesuffix("_d")]
        built = [library(control, origin, STEP) for library in libraries if hasattr(library, task)]
        table: Table = {library.name: [] for library in built}
        last: dict[str, float] = {}
        truth = Knotwork(control, origin, STEP)
        for n in sizes:
            points = rng.uniform(0, 10, n if task.startswith("curve") else (n, 2))
            calls = {}
            for library in built:
                if n != sizes[0]:  # one that sat out once stays out
                    more = n / sizes[sizes.index(n) - 1]
                    if last.get(library.name, np.inf) * more > limit:
                        continue
                call = getattr(library, task)
                if n == sizes[0]:
                    tolerance = getattr(library, "tolerance", 1e-6)
                    agree(library.name, parts(getattr(truth, task)(points)), parts(call(points)), tolerance)
                call(points)
                calls[library.name] = (call, points)
            last = race(calls, budget, rounds)
            for name, column in table.items():
                column.append(1e6 * last[name] if name in last else None)
            print(f"  {task} {n}", file=sys.stderr)
        out[task] = table
    return out


def growth(libraries: list[type[Library]], budget: float, rounds: int, limit: float) -> Table:
    """Time surface and partials at 1040 points as the map grows (Fig 4.7); the last column: scan-like points."""
    rng = np.random.default_rng(7)
    out: Table = {}
    estimate: dict[str, float] = {}
    for side in SIDES:
        control = rng.normal(size=(round(side / STEP) + 3,) * 2)
        sets = [rng.uniform(0, side, (1040, 2))]
        if side == SIDES[-1]:
            angle = np.linspace(0, 2 * np.pi, 1040, endpoint=False)
            ranges = 4.0 + np.cumsum(rng.normal(0, 0.02, 1040))
            sets.append(side / 2 + ranges[:, None] * np.column_stack((np.cos(angle), np.sin(angle))))
        built = {}
        for library in libraries:
            heavy = library.name in ("NURBS-Python (geomdl)", "bspline") and side > 10  # lists of 4 million points
            if hasattr(library, "surface_d") and not heavy and estimate.get(library.name, 0.0) * 100 < limit:
                built[library.name] = library(control, -3 * STEP, STEP)
        for points in sets:
            for library in built.values():
                library.surface_d(points)
            times = race({name: (library.surface_d, points) for name, library in built.items()}, budget, rounds)
            for library in libraries:
                if hasattr(library, "surface_d"):
                    out.setdefault(library.name, []).append(
                        1e6 * times[library.name] if library.name in times else None
                    )
        estimate = times
        print(f"  map of {side * side} m2", file=sys.stderr)
    return out


def one_point(libraries: list[type[Library]], budget: float, rounds: int) -> dict[str, float]:
    """Time value and gradient at one point, called from Python [us]."""
    control = np.random.default_rng(1).normal(size=(203, 203))
    calls = {}
    for library in libraries:
        if not hasattr(library, "surface_d") or library.name == "bspline":
            continue
        made = library(control, -3 * STEP, STEP)
        if isinstance(made, Knotwork):
            calls[made.name] = (lambda p, at=made.surface.at: at(p[0], p[1]), (4.321, 5.678))
        else:
            calls[made.name] = (made.surface_d, np.array([[4.321, 5.678]]))
        calls[made.name][0](calls[made.name][1])
    return {name: 1e6 * value for name, value in race(calls, budget, rounds).items()}


def start_up() -> list[float]:
    """Return wall and processor time [s] of import and first evaluation in a new process: compiling, cached.

    The last two are of `import numba` alone.
    """
    ours = "from knotwork.core.splines import Surface\nSurface().with_gradient([[0.0, 0.0]])"
    frame = "import time; t = time.perf_counter()\n{}\nprint(time.perf_counter() - t, time.process_time())"
    import os

    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}

        def measured(code: str) -> list[float]:
            call = [sys.executable, "-c", frame.format(code)]
            done = subprocess.run(call, env=environment, capture_output=True, text=True, check=True)
            return [float(value) for value in done.stdout.split()]

        first = measured(ours)
        cached, numba = ([measured(code) for _ in range(5)] for code in (ours, "import numba"))
    return first + [min(column) for runs in (cached, numba) for column in zip(*runs, strict=True)]


def markdown(table: Table, columns: list[str], title: str) -> str:
    """Return a table of microseconds and, in its last column, how many times our float32 goes into the 1040 time."""
    ours = table[KnotworkSingle.name]
    ratio = columns.index("1040") if "1040" in columns else len(columns) - 2
    lines = [f"\n{title}, us a call\n", f"| library | {' | '.join(columns)} | x ours at {columns[ratio]} |"]
    lines.append("| --- |" + " --: |" * (len(columns) + 1))
    for name, times in table.items():
        cells = [_figure(value) for value in times]
        factor = f"{times[ratio] / ours[ratio]:.1f}" if times[ratio] is not None else "-"
        lines.append(f"| {name} | {' | '.join(cells)} | {factor} |")
    return "\n".join(lines)


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:,.1f}" if value < 100 else f"{value:,.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for results.json, tables.md and the figures")
    parser.add_argument("--quick", action="store_true", help="fewer points and rounds, calls up to 0.2 s")
    arguments = parser.parse_args()
    logging.getLogger("numba").setLevel(logging.WARNING)
    budget, rounds, limit = (0.02, 3, 0.2) if arguments.quick else (0.03, 12, 6.0)
    sizes = SIZES[:3] if arguments.quick else SIZES
    libraries, missing = installed()
    result = {
        "tables": tables(libraries, sizes, budget, rounds, limit),
        "growth": growth(libraries, budget, rounds, limit * 10),
        "one_point": one_point(libraries, budget, rounds),
        "start": start_up(),
        "flops": flops(),
        "bandwidth": bandwidth(),
        "missing": missing,
        "sizes": sizes,
    }
    text = report(result)
    print(text)
    if arguments.out:
        from spline_figures import draw

        arguments.out.mkdir(parents=True, exist_ok=True)
        (arguments.out / "results.json").write_text(json.dumps(result, indent=1))
        (arguments.out / "tables.md").write_text(text + "\n")
        draw(result, arguments.out)


def report(result: dict) -> str:
    """Return everything as Markdown."""
    sizes = [str(n) for n in result["sizes"]]
    lines = [markdown(result["tables"][task], sizes, title) for task, title in TASKS.items()]
    areas = [f"{side * side:,} m2" for side in SIDES] + [f"{SIDES[-1] ** 2:,} m2, a scan"]
    lines.append(markdown(result["growth"], areas, "Surface and partials, 1040 points, as the map grows (Fig 4.7)"))
    lines.append("\nOne point from Python, value and gradient, us\n\n| library | us |\n| --- | --: |")
    lines += [f"| {name} | {_figure(value)} |" for name, value in result["one_point"].items()]
    ours = result["tables"]["surface_d"][KnotworkSingle.name][2]
    thesis = result["tables"]["surface_d"][Thesis.name][2]
    arithmetic = 1e6 * 1040 * 140 / result["flops"]
    memory = 1e6 * 1040 * 6 * 64 / result["bandwidth"]
    cold, cold_cpu, warm, warm_cpu, numba, numba_cpu = result["start"]
    lines.append(
        f"\nBounds of this machine for surface and partials at 1040 points: arithmetic {arithmetic:.1f} us "
        f"(140 flops a point at {result['flops'] / 1e9:.0f} Gflop/s, one core), memory {memory:.1f} us if nothing "
        f"is cached (six lines a point at {result['bandwidth'] / 1e9:.0f} GB/s); ours {ours:.1f} us, "
        f"{thesis / ours:.1f} times faster than the thesis's way."
    )
    lines.append(
        f"Import and first evaluation, wall (processor) time: {warm:.2f} ({warm_cpu:.2f}) s with cached kernels, of it "
        f"{numba:.2f} ({numba_cpu:.2f}) s `import numba`; {cold:.1f} ({cold_cpu:.1f}) s compiling."
    )
    for name, why in result["missing"].items():
        lines.append(f"Not here: {name} ({why}).")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
