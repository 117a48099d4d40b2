"""Scores against relations between poses.

Kuemmerle et al., "On measuring the accuracy of SLAM algorithms", Autonomous Robots 27 (2009); thesis
equations (5.13) and (5.14), split into translation and rotation.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.errors import InputError
from knotwork.core.evaluation.se2 import relative
from knotwork.core.evaluation.table import read_table
from knotwork.core.evaluation.tum import StampedPoses
from knotwork.core.messages import F64, I64

SHORT = 10 * 10**9  # ns; compared as integers, 60 s are not more than 60 s
LONG = 60 * 10**9  # ns
TOLERANCE = 1e-4  # s


@dataclass(frozen=True, slots=True, eq=False)
class Relations:
    """Measured relative poses of the robot.

    Attributes
    ----------
    first, second : int64, shape (n,)
        Stamps [ns]; the second may be the earlier one.
    poses : float64, shape (n, 3)
        Pose at `second` seen from the robot at `first`: x [m], y [m], yaw [rad].
    """

    first: I64
    second: I64
    poses: F64


def read_relations(path: str | Path) -> Relations:
    """Read `t1 t2 x y z roll pitch yaw` lines (plain, .gz or .xz); z, roll and pitch are dropped.

    Raises
    ------
    InputError
        The file cannot be read or has another format.
    """
    stamps, values, _ = read_table(path, 2, (8,), "relations of 8 numbers (t1 t2 x y z roll pitch yaw)")
    return Relations(stamps[:, 0], stamps[:, 1], values[:, [0, 1, 5]])


def score_relations(trajectory: StampedPoses, relations: Relations, tolerance: float = TOLERANCE) -> dict[str, Any]:
    """Score a trajectory of robot poses by the errors of `relation_errors`.

    Returns
    -------
    dict
        Mean and population standard deviation of |e_trans|, |e_trans|^2, |e_rot|, |e_rot|^2
        (`trans_abs_mean_m`, `trans_abs_std_m`, `trans_sq_mean_m2`, `trans_sq_std_m2`,
        `rot_abs_mean_deg`, `rot_abs_std_deg`, `rot_sq_mean_deg2`, `rot_sq_std_deg2`; None without a
        relation), `used`, `missed`; the same under `short` (|t2 - t1| < 10 s) and `long` (> 60 s).

    Raises
    ------
    InputError
        No relation matches.
    """
    trans, rot, used = relation_errors(trajectory, relations, tolerance)
    apart = np.abs(relations.second - relations.first)
    result = _figures(trans, rot, used, np.ones_like(used))
    result["short"] = _figures(trans, rot, used, apart < SHORT)
    result["long"] = _figures(trans, rot, used, apart > LONG)
    return result


def relation_errors(
    trajectory: StampedPoses, relations: Relations, tolerance: float = TOLERANCE
) -> tuple[F64, F64, NDArray[np.bool_]]:
    """Return |e_trans| [m], |e_rot| [deg] of each relation, e = measured^-1 * estimated, and which are used.

    Each time of a relation is matched to the nearest pose within `tolerance` [s]; a relation without
    both is missed, its errors mean nothing. Three arrays of shape (n,).

    Raises
    ------
    InputError
        No relation matches.
    """
    first = trajectory.nearest(relations.first, tolerance)
    second = trajectory.nearest(relations.second, tolerance)
    used = (first >= 0) & (second >= 0)
    if not used.any():
        raise InputError(
            f"none of the {used.size} relations matches the trajectory within {tolerance:g} s:"
            f" trajectory {_span(trajectory.stamps)}, relations {_span(relations.first)}",
            hint="do both belong to the same log?",
        )
    estimated = relative(trajectory.poses[first], trajectory.poses[second])
    error = relative(relations.poses, estimated)
    trans = np.hypot(error[:, 0], error[:, 1])
    rot = np.degrees(np.abs(error[:, 2]))
    return trans, rot, used


def _figures(trans: F64, rot: F64, used: NDArray[np.bool_], subset: NDArray[np.bool_]) -> dict[str, Any]:
    chosen = used & subset
    result: dict[str, Any] = {}
    for name, values, unit in (("trans", trans[chosen], "m"), ("rot", rot[chosen], "deg")):
        for power, what, square in ((values, "abs", ""), (values**2, "sq", "2")):
            result[f"{name}_{what}_mean_{unit}{square}"] = float(power.mean()) if power.size else None
            result[f"{name}_{what}_std_{unit}{square}"] = float(power.std()) if power.size else None
    result["used"] = int(chosen.sum())
    result["missed"] = int((subset & ~used).sum())
    return result


def _span(stamps: I64) -> str:
    return f"{stamps.min() * 1e-9:.3f} to {stamps.max() * 1e-9:.3f} s"
