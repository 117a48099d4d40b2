"""`experiment depth-robot`: a wheeled base backs up until it knows the depths, then drives to a goal view."""

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from knotwork.core.messages import F64
from knotwork.core.world.seeding import generator
from knotwork.plugins.commands.experiment import figures
from knotwork.plugins.commands.experiment.base_batch import run_base
from knotwork.plugins.commands.experiment.parts import Part, run_parts, write_json
from knotwork.plugins.commands.experiment.scenarios import error_seed
from knotwork.plugins.commands.experiment.scoring import median, wilson

STEP, STEPS = 0.05, 400  # s; 20 s
V_MAX, W_MAX = 0.20, 1.0  # m/s, rad/s; a Burger does 0.2097 m/s
OFFSET = 0.08  # m, camera ahead of the axle
BACK = 0.3  # m
PAUSE = 0.5  # s, standing before and after
SWING = 0.2  # rad, of the heading on the way back
NOISE = 5e-4  # of a normalised image coordinate
DEVIATION = 0.015  # relative standard deviation at which a depth is taken as known
SUCCESS = 0.02  # |e| at the end
_BLOCK = 50


class DepthRobot:
    """Nine points by default, noise 5e-4, 0.20 m/s."""

    def arguments(self, parser: Any) -> None:
        """Add what can be chosen."""
        parser.add_argument("--points", type=int, nargs="+", default=[9], metavar="N", help="default 9")

    def run(self, arguments: Any) -> int:
        """Run, write results.json and the figure, print a table."""
        out = Path(arguments.out)
        parts = [
            Part("robot", "image-5e-4", "ekf", n, arguments.seed, first, min(_BLOCK, arguments.runs - first))
            for n in arguments.points
            for first in range(0, arguments.runs, _BLOCK)
        ]
        done = run_parts(parts, block, out / "parts", arguments.jobs)
        runs = {n: [run for part in parts if part.n == n for run in done[part]] for n in arguments.points}
        results = {str(n): summarise(rows) for n, rows in runs.items()}
        write_json(out / "results.json", results)
        if not arguments.no_figures:
            _draw(out, arguments.points[-1], arguments.seed)
        if arguments.json:
            sys.stdout.write(json.dumps(results, indent=1) + "\n")
        else:
            for n, row in results.items():
                sys.stdout.write(f"{n} points, {row['runs']} runs\n")
                for name, value in row.items():
                    sys.stdout.write(f"  {name:<28} {value:.3f}\n" if value is not None and name != "runs" else "")
        return 0


def scene(n: int, seed: int, index: int) -> tuple[F64, F64, F64]:
    """Draw points (n, 3), their image from a goal on an arc ahead (n, 2), guesses (n,) [1/m]."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(n, index)))
    while True:
        depth = rng.uniform(1.0, 4.0, n)
        image = rng.uniform((-0.45, -0.3), (0.45, 0.3), (n, 2))
        points = np.column_stack((image * depth[:, None], depth))
        length, turn = rng.uniform(0.3, 1.0), math.radians(rng.uniform(-20.0, 20.0))
        half = 0.5 * turn
        chord = length * (math.sin(half) / half if half else 1.0)
        there = seen_from(points, np.array((chord * math.cos(half), chord * math.sin(half), turn)))
        if there[:, 2].min() > 0.3:
            return points, there[:, :2] / there[:, 2:], 1.0 / rng.uniform(0.3, 6.0, n)


def seen_from(points: F64, pose: F64) -> F64:
    """Return points (n, 3) of the first camera frame as the camera of a base at `pose` (x, y, yaw) has them."""
    x, y = points[:, 2] + OFFSET - pose[0], -points[:, 0] - pose[1]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.column_stack((s * x - c * y, points[:, 1], c * x + s * y - OFFSET))


def trace(n: int, seed: int, index: int) -> tuple[float, F64, F64, F64]:
    """Run one scenario; return metres backed up, image errors, depth errors and base poses of each frame."""
    points, goal, guess = scene(n, seed, index)
    noise = NOISE * generator(error_seed(seed, index), "image").normal(size=(STEPS + 1, n, 2))
    errors, depth_errors, poses = np.empty(STEPS + 1), np.full(STEPS + 1, np.inf), np.zeros((STEPS + 1, 3))
    way = run_base(
        points, goal, guess, np.array((NOISE, 3.0, 1e-4, 0.0)), OFFSET, np.array((V_MAX, W_MAX)), BACK, PAUSE,
        SWING, DEVIATION, STEP, noise, np.array((0.7, 0.5)), errors, depth_errors, poses,
    )  # fmt: skip
    return way, errors, depth_errors, poses


def block(part: Part) -> list[dict[str, Any]]:
    """Run the scenarios of a part."""
    out = []
    for index in range(part.first, part.first + part.count):
        way, errors, depth_errors, poses = trace(part.n, part.seed, index)
        turned = int(np.argmin(poses[:, 0]))  # the farthest frame back
        late = np.flatnonzero(~(errors < SUCCESS))
        settled = 0 if not late.size else int(late[-1]) + 1
        out.append(
            {
                "back_m": way,
                "back_s": turned * STEP,
                "depth_error_after_back": float(depth_errors[turned]),
                "depth_error_end": float(depth_errors[-1]),
                "error_end": float(errors[-1]) if np.isfinite(errors[-1]) else None,
                "settled_s": settled * STEP if settled <= STEPS else None,
            }
        )
    return out


def summarise(runs: list[dict[str, Any]]) -> dict[str, float | None]:
    """Return the shares of runs that got there, with 95 % intervals."""
    known = sum(0.0 <= run["back_m"] <= BACK + 1e-9 and run["depth_error_after_back"] < 0.05 for run in runs)
    there = sum(run["settled_s"] is not None for run in runs)
    known_low, known_high = wilson(known, len(runs))
    there_low, there_high = wilson(there, len(runs))
    return {
        "runs": len(runs),
        "depths_within_5_percent": known / len(runs),
        "depths_ci_low": known_low,
        "depths_ci_high": known_high,
        "goal_reached": there / len(runs),
        "goal_ci_low": there_low,
        "goal_ci_high": there_high,
        "back_median_m": median([run["back_m"] for run in runs]),
        "back_max_m": max(run["back_m"] for run in runs),
        "goal_time_median_s": median([run["settled_s"] for run in runs if run["settled_s"] is not None]),
    }


def _draw(out: Path, n: int, seed: int) -> None:
    figure, axes = figures.subplots(1, 3, figsize=(14, 4.5))
    for index in range(12):
        _, errors, depth_errors, poses = trace(n, seed, index)
        time = np.arange(STEPS + 1) * STEP
        axes[0].plot(poses[:, 0], poses[:, 1], linewidth=1)
        axes[1].semilogy(time, depth_errors, linewidth=1)
        axes[2].semilogy(time, errors, linewidth=1)
    axes[0].set_aspect("equal", adjustable="datalim")
    axes[1].axhline(0.05, color="0.6", linewidth=0.8)
    axes[2].axhline(SUCCESS, color="0.6", linewidth=0.8)
    figures.label(axes[0], "x [m]", "y [m]", "paths of the base, twelve scenarios")
    figures.label(axes[1], "time [s]", "largest relative depth error")
    figures.label(axes[2], "time [s]", "image error")
    figures.save(figure, out, "depth-robot")
