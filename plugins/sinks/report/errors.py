"""How far a run's estimates are from what is known."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from knotwork.core.errors import KnotworkError
from knotwork.core.evaluation import relations, trajectory_error
from knotwork.core.evaluation.tum import StampedPoses, read_tum
from knotwork.core.geometry import Pose2, relative
from knotwork.core.messages import F64
from knotwork.plugins.sinks.report import ReportConfig

Rows = list[tuple[str, ...]]


class Poses:
    """Poses of one stream, by scan; a corrected one replaces what was there."""

    def __init__(self) -> None:
        self.stamps: dict[int, int] = {}
        self.poses: dict[int, Pose2] = {}

    def add(self, scan: int, stamp: int, pose: Pose2) -> None:
        """Take the pose of a scan."""
        if all(map(math.isfinite, pose)):
            self.stamps[scan] = stamp
            self.poses[scan] = pose

    def array(self) -> F64:
        """Return all poses (n, 3)."""
        return np.array(list(self.poses.values()), np.float64).reshape(-1, 3)

    def stamped(self) -> StampedPoses:
        """Return all poses with their stamps."""
        return StampedPoses(np.array(list(self.stamps.values()), np.int64), self.array())


def in_map(truth: Poses) -> Poses:
    """Return true poses as seen from the first one, which fixes the map's frame."""
    out = Poses()
    origin = next(iter(truth.poses.values()), None)
    for scan, pose in truth.poses.items():
        assert origin is not None
        out.add(scan, truth.stamps[scan], relative(origin, pose))
    return out


def against_truth(estimate: Poses, truth: Poses) -> F64:
    """Return (n, 3): stamp [s, since the first], position error [m], heading error [deg] of each scan both have."""
    scans = [scan for scan in estimate.poses if scan in truth.poses]
    out = np.zeros((len(scans), 3))
    for row, scan in enumerate(scans):
        x, y, yaw = relative(truth.poses[scan], estimate.poses[scan])
        out[row] = (estimate.stamps[scan] - estimate.stamps[scans[0]]) * 1e-9, math.hypot(x, y), math.degrees(yaw)
    return out


def against_files(config: ReportConfig, estimate: Poses) -> tuple[list[tuple[str, Rows]], list[str]]:
    """Return tables (title, rows) of the files that the config names, and what was wrong with them."""
    tables: list[tuple[str, Rows]] = []
    wrong: list[str] = []
    for name, score in ((config.relations, _relations), (config.reference, _reference)):
        if not name:
            continue
        if not estimate.poses:
            wrong.append(f"{name}: there is no estimated pose to compare with it")
            continue
        try:
            tables.append((Path(name).name, score(name, estimate.stamped(), config.tolerance)))
        except KnotworkError as error:
            wrong.append(f"{name}: {error}")
    return tables, wrong


def _relations(name: str, estimate: StampedPoses, tolerance: float) -> Rows:
    score = relations.score_relations(estimate, relations.read_relations(name), tolerance)
    rows: Rows = [("relations", "used", "missed", "trans [m]", "trans² [m²]", "rot [deg]", "rot² [deg²]")]
    for title, part in (("all", score), ("|t2 - t1| < 10 s", score["short"]), ("|t2 - t1| > 60 s", score["long"])):
        keys = (("trans_abs", "m"), ("trans_sq", "m2"), ("rot_abs", "deg"), ("rot_sq", "deg2"))
        cells = (_spread(part[f"{key}_mean_{unit}"], part[f"{key}_std_{unit}"]) for key, unit in keys)
        rows.append((title, str(part["used"]), str(part["missed"]), *cells))
    return rows


def _reference(name: str, estimate: StampedPoses, tolerance: float) -> Rows:
    score: dict[str, Any] = trajectory_error.score_trajectory(estimate, read_tum(name), "se2", tolerance)
    rows: Rows = [("error", "pairs", "position rmse [m]", "max [m]", "heading rmse [deg]", "max [deg]")]
    for key, title in (("ate", "absolute, aligned"), ("rpe_frame", "from scan to scan"), ("rpe_metre", "per metre")):
        part = score[key]
        figures = (part[name] for name in ("trans_rmse_m", "trans_max_m", "rot_rmse_deg", "rot_max_deg"))
        rows.append((title, str(part["pairs"]), *("" if v is None else f"{v:.4f}" for v in figures)))
    return rows


def _spread(mean: float | None, deviation: float | None) -> str:
    return "" if mean is None or deviation is None else f"{mean:.4f} ± {deviation:.4f}"
