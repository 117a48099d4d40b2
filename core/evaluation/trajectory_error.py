"""Absolute and relative trajectory error of planar trajectories, after Sturm et al. 2012."""

from typing import Any, Literal

import numpy as np

from knotwork.core.errors import InputError
from knotwork.core.evaluation.se2 import compose, relative
from knotwork.core.evaluation.tum import StampedPoses
from knotwork.core.messages import F64, I64

Align = Literal["none", "se2"]
TOLERANCE = 0.01  # s


def score_trajectory(
    estimate: StampedPoses, reference: StampedPoses, align: Align = "none", tolerance: float = TOLERANCE
) -> dict[str, Any]:
    """Score an estimated trajectory against a reference.

    Each estimated pose is matched to the nearest reference pose within `tolerance` [s]; pairs keep the
    order of the estimate's file.

    Returns
    -------
    dict
        `matched`, `missed`, `align`; `ate`: error reference^-1 * estimate of every pose after alignment;
        `rpe_frame`: error of the motion from one matched pose to the next; `rpe_metre`: the same over
        stretches of a metre of the estimate's path. Each holds `trans_rmse_m`, `trans_mean_m`,
        `trans_median_m`, `trans_std_m`, `trans_min_m`, `trans_max_m`, the same as `rot_..._deg`, and
        `pairs`; figures are None without a pair.

    Raises
    ------
    InputError
        No pose matches.
    """
    index = reference.nearest(estimate.stamps, tolerance)
    matched = index >= 0
    if not matched.any():
        raise InputError(
            f"no estimated pose has a reference pose within {tolerance:g} s",
            hint="do both belong to the same log?",
        )
    ours, theirs = estimate.poses[matched], reference.poses[index[matched]]
    aligned = compose(align_se2(ours, theirs), ours) if align == "se2" else ours
    frames = np.arange(ours.shape[0])
    metres = _every_metre(ours)
    return {
        "matched": int(matched.sum()),
        "missed": int((~matched).sum()),
        "align": align,
        "ate": _figures(relative(theirs, aligned)),
        "rpe_frame": _figures(_motion_errors(ours, theirs, frames)),
        "rpe_metre": _figures(_motion_errors(ours, theirs, metres)),
    }


def align_se2(poses: F64, reference: F64) -> F64:
    """Return the transform (3,) that moves `poses` (n, 3) onto `reference` with least squared distances.

    Umeyama's method without scale, on positions only; in the plane its rotation is an arctangent.
    """
    centre, target = poses[:, :2].mean(axis=0), reference[:, :2].mean(axis=0)
    a, b = poses[:, :2] - centre, reference[:, :2] - target
    yaw = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    turned = compose(np.array((0.0, 0.0, yaw)), np.array((*centre, 0.0)))
    return np.array((target[0] - turned[0], target[1] - turned[1], yaw))


def _every_metre(poses: F64) -> I64:
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    marks = [0]
    path = 0.0
    for index, step in enumerate(steps, start=1):
        path += step
        if path >= 1.0:
            marks.append(index)
            path = 0.0
    return np.array(marks)


def _motion_errors(ours: F64, theirs: F64, marks: I64) -> F64:
    start, end = marks[:-1], marks[1:]
    return relative(relative(theirs[start], theirs[end]), relative(ours[start], ours[end]))


def _figures(errors: F64) -> dict[str, Any]:
    result: dict[str, Any] = {"pairs": errors.shape[0]}
    trans = np.hypot(errors[:, 0], errors[:, 1])
    rot = np.degrees(np.abs(errors[:, 2]))
    for name, values, unit in (("trans", trans, "m"), ("rot", rot, "deg")):
        known = values.size > 0
        result[f"{name}_rmse_{unit}"] = float(np.sqrt(np.mean(values**2))) if known else None
        for what in ("mean", "median", "std", "min", "max"):
            result[f"{name}_{what}_{unit}"] = float(getattr(np, what)(values)) if known else None
    return result
