"""Planar trajectories in TUM files: `stamp x y z qx qy qz qw` a line, robot frame, log order."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from knotwork.core.errors import InputError
from knotwork.core.evaluation.table import read_table
from knotwork.core.messages import F64, I64
from knotwork.core.stamps import format_seconds

_EXPECTED = "TUM lines of 8 numbers (stamp x y z qx qy qz qw) or lines of 4 (stamp x y yaw)"


@dataclass(frozen=True, slots=True, eq=False)
class StampedPoses:
    """A trajectory in the order of its file; stamps may run backwards.

    Attributes
    ----------
    stamps : int64, shape (n,)
        Nanoseconds.
    poses : float64, shape (n, 3)
        x [m], y [m], yaw [rad].
    """

    stamps: I64
    poses: F64

    def nearest(self, stamps: I64, tolerance: float) -> I64:
        """Return the index of the pose nearest to each stamp, -1 where none lies within `tolerance` [s].

        Of equally near poses the earlier one wins, of equal stamps the first one of the file.
        """
        order = np.argsort(self.stamps, kind="stable")
        ordered = self.stamps[order]
        after = np.searchsorted(ordered, stamps, side="left")
        before = np.searchsorted(ordered, ordered[np.maximum(after - 1, 0)], side="left")
        after = np.minimum(after, ordered.size - 1)
        to_before, to_after = np.abs(stamps - ordered[before]), np.abs(ordered[after] - stamps)
        best = np.where(to_before <= to_after, before, after)
        near = np.minimum(to_before, to_after) <= tolerance * 1e9 + 0.5
        return np.where(near, order[best], -1)


def read_tum(path: str | Path) -> StampedPoses:
    """Read a TUM file (plain, .gz or .xz), or one of `stamp x y yaw` lines; z, roll and pitch are dropped.

    Raises
    ------
    InputError
        The file cannot be read, has another format, or a quaternion of length 0.
    """
    stamps, values, numbers = read_table(path, 1, (8, 4), _EXPECTED)
    if values.shape[1] == 3:
        return StampedPoses(stamps[:, 0], values)
    x, y, _, qx, qy, qz, qw = values.T
    norm = qx * qx + qy * qy + qz * qz + qw * qw
    bad = np.flatnonzero(~((norm > 1e-12) & np.isfinite(norm)))
    if bad.size:
        raise InputError("the quaternion has no direction", where=f"{path}:{numbers[bad[0]]}", hint="expected length 1")
    yaw = np.arctan2(2.0 * (qw * qz + qx * qy), norm - 2.0 * (qy * qy + qz * qz))
    return StampedPoses(stamps[:, 0], np.stack((x, y, yaw), axis=1))


def tum_line(stamp: int, pose: Sequence[float] | F64) -> str:
    """Return one TUM line without its end; `stamp` [ns], `pose` x, y, yaw of the robot."""
    x, y, half = float(pose[0]), float(pose[1]), 0.5 * float(pose[2])
    return f"{format_seconds(stamp)} {x:.6f} {y:.6f} 0 0 0 {math.sin(half):.9f} {math.cos(half):.9f}"


def write_tum(path: str | Path, stamps: Iterable[int], poses: Iterable[Sequence[float] | F64]) -> None:
    """Write a TUM file; `stamps` [ns] and `poses` (x, y, yaw) in log order."""
    with Path(path).open("w", encoding="ascii") as file:
        for stamp, pose in zip(stamps, poses, strict=True):
            file.write(tum_line(int(stamp), pose) + "\n")
