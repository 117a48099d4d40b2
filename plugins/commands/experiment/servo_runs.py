"""Blocks of multi-point scenarios: what each mode, setting and disturbance means, and how a run is judged."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from knotwork.core.depth.observer import CHI_MAX, CHI_MIN
from knotwork.core.messages import F64
from knotwork.core.world.seeding import generator
from knotwork.plugins.commands.experiment.parts import Part
from knotwork.plugins.commands.experiment.scenarios import SETTINGS, Scenario, error_seed, scenario
from knotwork.plugins.commands.experiment.servo_batch import EKF, FIXED_GAIN, KNOWN, run_servo

STEP, STEPS = 0.05, 300  # s; 15 s
V_MAX, W_MAX = 0.1, 0.15  # m/s, rad/s
K_S, K_CHI = 10.0, 2500.0
WINDOW = 10  # frames
SUCCESS = 0.01  # |e| at the end


@dataclass(frozen=True, slots=True)
class Mode:
    """Where depths come from, whether (9.46)'s rows hold, share of v_max of the excitation row (< 0: none)."""

    estimator: int
    constrained: bool
    beta: float


MODES = {
    "ideal": Mode(KNOWN, False, -1.0),
    "passive": Mode(FIXED_GAIN, False, -1.0),
    "active": Mode(FIXED_GAIN, True, -1.0),
    "active+": Mode(FIXED_GAIN, True, 0.9),
    "ekf": Mode(EKF, False, -1.0),
    "ekf active+": Mode(EKF, True, 0.9),
}


@dataclass(frozen=True, slots=True)
class Disturbance:
    """What is not as the model says.

    Attributes
    ----------
    image
        Standard deviation of a normalised image coordinate.
    scale, white
        Standard deviations of a constant relative error of each axis of the twist, and of a new error in each
        frame relative to v_max and w_max.
    loss
        Probability that a point is missed in a frame.
    """

    image: float = 0.0
    scale: float = 0.0
    white: float = 0.0
    loss: float = 0.0


DISTURBANCES = {
    "none": Disturbance(),
    "image-1e-3": Disturbance(image=1e-3),
    "image-3e-3": Disturbance(image=3e-3),
    "scale-5": Disturbance(image=3e-4, scale=0.05),
    "white-5": Disturbance(image=3e-4, white=0.05),
    "loss-20": Disturbance(image=3e-4, loss=0.2),
}


@dataclass(frozen=True, slots=True)
class Trace:
    """A run frame by frame, as `run_servo` writes it; `whole` is False if a point came too near."""

    errors: F64
    phases: F64
    chi_error: F64
    path: F64
    whole: bool


def trace(scene: Scenario, mode: str, gain: float, disturbance: str, seed: int, steps: int = STEPS) -> Trace:
    """Run one scenario; the random errors depend on `seed` only."""
    kind, wrong = MODES[mode], DISTURBANCES[disturbance]
    n = len(scene.points)
    noise, seen = np.zeros((steps + 1, n, 2)), np.ones((steps + 1, n))
    scale, white = np.ones(6), np.zeros((steps, 6))
    limits = np.array((V_MAX, W_MAX))
    if wrong.image:
        noise = wrong.image * generator(seed, "image").normal(size=noise.shape)
    if wrong.loss:
        seen = (generator(seed, "loss").random(seen.shape) >= wrong.loss).astype(np.float64)
    if wrong.scale:
        scale = 1.0 + wrong.scale * generator(seed, "scale").normal(size=6)
    if wrong.white:
        white = wrong.white * np.repeat(limits, 3) * generator(seed, "white").normal(size=white.shape)
    moving = wrong.scale > 0.0 or wrong.white > 0.0
    filter_sd = np.array((max(1e-3, wrong.image), 3.0, 2e-3 if moving else 1e-4, 0.05 if moving else 0.0))
    if kind.estimator == EKF:
        thresholds = np.array((0.05, 0.2))
    else:
        # E has a floor of about 2.5 times the variance of the image, to which a twist that errs anew in each frame
        # adds: a depth would never count as certain below it. The factor 2 is the observer's memory of past frames.
        floor = wrong.image**2 + 2.0 * (wrong.white * STEP) ** 2 * (V_MAX**2 + W_MAX**2)
        thresholds = np.array((max(1e-7, 4 * floor), max(1e-6, 8 * floor)))
    errors, phases = np.full(steps + 1, np.inf), np.zeros(steps + 1)
    chi_error, path = np.full((steps + 1, n), np.nan), np.zeros((steps + 1, 12))
    guess = np.clip(scene.guess, CHI_MIN, CHI_MAX)
    whole = run_servo(
        scene.points, scene.goal, guess, kind.estimator, kind.constrained, kind.beta, gain,
        np.array((K_S, K_CHI, 1e-4)), filter_sd, thresholds, WINDOW, STEP, limits,
        noise, seen, scale, white, errors, phases, chi_error, path,
    )  # fmt: skip
    return Trace(errors, phases, chi_error, path, whole)


def judge(scene: Scenario, run: Trace) -> dict[str, Any]:
    """Return success, settling time [s], sum of depth errors [m] at the end, last phase, last speed [m/s]."""
    late = np.flatnonzero(~(run.errors < SUCCESS))
    settled = 0 if not late.size else int(late[-1]) + 1
    success = run.whole and bool(run.errors[-1] < SUCCESS)
    depth_error = None
    if run.whole:
        rotation = run.path[-1, 3:].reshape(3, 3)
        z = ((scene.points - run.path[-1, :3]) @ rotation)[:, 2]
        depth_error = float(np.abs(z - 1.0 / (1.0 / z + run.chi_error[-1])).sum())
    return {
        "success": success,
        "settled_s": settled * STEP if success else None,
        "depth_error_m": depth_error,
        "error": float(run.errors[-1]) if run.whole else None,
        "phase": int(run.phases[-1]),
        "failed_solves": int((run.phases == 0.0).sum()) if run.whole else 0,
        "speed": float(np.linalg.norm(run.path[-1, :3] - run.path[-21, :3])),
    }


def block(part: Part) -> list[dict[str, Any]]:
    """Run the scenarios of a part."""
    setting = SETTINGS[part.setting]
    out = []
    for index in range(part.first, part.first + part.count):
        scene = scenario(setting, part.n, part.seed, index)
        run = trace(scene, part.mode, setting.gain, part.disturbance, error_seed(part.seed, index))
        out.append(judge(scene, run))
    return out
