"""The scenes of section 9.3.1: one point at 1 m, guessed at 10 m."""

from typing import Any

import numpy as np

from knotwork.core.depth.single_point import CONSTANT_DEPTH, SPICA14, VARYING_DEPTH
from knotwork.core.messages import F64
from knotwork.plugins.commands.experiment.single_batch import COLUMNS, run_single

STEP = 0.05  # s
VARIANTS = {"spica14": SPICA14, "varying-depth": VARYING_DEPTH, "constant-depth": CONSTANT_DEPTH}
GOAL = (0.2, 0.1)
CIRCLE, PERIOD = 0.1, 10.0  # of the moving goal, s
K_CHI = 2500.0


def single(
    variant: str,
    *,
    k_chi: float = K_CHI,
    gain: float = 1.0,
    direction: float = 0.7,
    circle: float = 0.0,
    feed_forward: bool = True,
    printed: bool = False,
    duration: float = 20.0,
    noise: F64 | None = None,
) -> dict[str, F64]:
    """Run one scene; return its columns (K+1,) by name. `direction` [rad] is where the point starts from the goal.

    `printed` takes Algorithm 9 as the thesis prints it.
    """
    frames = round(duration / STEP) + 1
    goal = (0.0, 0.0) if variant == "spica14" and circle == 0.0 else GOAL
    start = np.array((goal[0] + 0.2 * np.cos(direction), goal[1] + 0.2 * np.sin(direction), 1.0))
    table = np.empty((frames, len(COLUMNS)))
    run_single(
        VARIANTS[variant], start, 0.1, np.array((*goal, circle, PERIOD)), gain, feed_forward, printed,
        np.array((10.0, k_chi, 1e-4)), STEP, np.array((0.1, 0.15)),
        np.zeros((frames, 2)) if noise is None else noise, table,
    )  # fmt: skip
    return {name: table[:, i] for i, name in enumerate(COLUMNS)}


def stays_below(time: F64, value: F64, bound: float) -> float | None:
    """Return from when on |value| stays below `bound`; None if it never does."""
    above = np.flatnonzero(~(np.abs(value) < bound))
    if not above.size:
        return float(time[0])
    return None if above[-1] == time.size - 1 else float(time[above[-1] + 1])


def figures_of(run: dict[str, F64]) -> dict[str, Any]:
    """Return what is compared with the thesis."""
    time, wrong = run["time"], run["chi"] - run["chi_hat"]
    v = np.column_stack((run["v_x"], run["v_y"]))
    at = {f"error_{t}s": float(run["error"][np.searchsorted(time, t - 1e-9)]) for t in (2, 5, 10) if t <= time[-1]}
    return {
        "t_0.05_s": stays_below(time, wrong, 0.05),
        "t_0.01_s": stays_below(time, wrong, 0.01),
        "overshoot": float(max(0.0, -wrong.min())),
        "sigma2_min": float(run["sigma2"].min()),
        "sigma2_max": float(run["sigma2"].max()),
        "J_l_w_min": float(run["J_l w"].min()),
        "J_l_w_max": float(run["J_l w"].max()),
        "flips": int((np.einsum("ij,ij->i", v[1:], v[:-1]) < 0.0).sum()),
        "depth_end_m": float(1.0 / run["chi"][-1]),
        "depth_error_tail": float(np.abs(wrong[time >= time[-1] - 5.0]).max()),
        "error_steady": float(run["error"][time >= time[-1] - 5.0].max()),
        **at,
    }
