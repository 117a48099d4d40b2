"""How far estimates are from the truth, scan by scan."""

import math
from typing import Any

from knotwork.core.geometry import Pose2, relative, wrap

_WAITING = 1000  # poses; without a truth every estimate would wait for ever


class TruthError:
    """Pairs estimates with true poses by `scan_id`.

    Both are taken relative to the first true pose, which fixes the map's frame; nothing is aligned
    afterwards. Estimates that say `lost` are left out, and so is a pose whose other half does not come
    before a thousand others wait.
    """

    def __init__(self) -> None:
        self._origin: Pose2 | None = None
        self._waiting: dict[tuple[str, int], Pose2] = {}
        self._n = 0
        self._squares = 0.0  # m^2
        self._worst = 0.0  # m
        self._turns = 0.0  # rad^2

    def add(self, role: str, scan_id: int, pose: Pose2) -> None:
        """Take a pose of role "truth" or "estimate": x [m], y [m], yaw [rad]."""
        if role == "truth":
            if self._origin is None:
                self._origin = pose
            pose = relative(self._origin, pose)
        other = self._waiting.pop(("estimate" if role == "truth" else "truth", scan_id), None)
        if other is None:
            self._waiting[role, scan_id] = pose
            if len(self._waiting) > _WAITING:
                del self._waiting[next(iter(self._waiting))]
            return
        square = (pose[0] - other[0]) ** 2 + (pose[1] - other[1]) ** 2
        self._n += 1
        self._squares += square
        self._worst = max(self._worst, math.sqrt(square))
        self._turns += wrap(pose[2] - other[2]) ** 2

    def summary(self) -> dict[str, Any] | None:
        """Return n, position_rms_m, position_max_m, heading_rms_deg; None without a pair."""
        if not self._n:
            return None
        return {
            "n": self._n,
            "position_rms_m": math.sqrt(self._squares / self._n),
            "position_max_m": self._worst,
            "heading_rms_deg": math.degrees(math.sqrt(self._turns / self._n)),
        }
