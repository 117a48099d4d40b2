"""Finding a lost robot again."""

import math
from dataclasses import dataclass

import numpy as np

from knotwork.core.contracts import Map
from knotwork.core.geometry import compose, relative
from knotwork.core.messages import F64, Scan
from knotwork.plugins.localizers.gauss_newton.descent import Found, discover
from knotwork.plugins.localizers.gauss_newton.solver import Settings
from knotwork.plugins.localizers.gauss_newton.starts import around

_NEAR = (0.2, 0.2)  # [m, rad] around a place found once, for the scan that has to confirm it
_CONFIRMING = 40  # starts there
_GROWTH = 0.25  # of the first radius, a scan


@dataclass(frozen=True, slots=True)
class Candidate:
    """Where one scan may have been taken: pose (3,), and the prior (3,) of that scan."""

    pose: F64
    prior: F64

    def confirm(self, chart: Map, scan: Scan, prior: F64, twist: F64 | None, settings: Settings) -> Found:
        """Return the best pose near here for a later scan, whose prior says how the robot has moved since."""
        moved = np.array(compose(self.pose.tolist(), relative(self.prior.tolist(), prior.tolist())))
        return discover(chart, scan, around(moved, *_NEAR, _CONFIRMING), twist, settings)


class Search:
    """One search, from the scan that was lost to the two in a row that agree on a place.

    Starts lie in a growing disc, around the prior and around the last believed pose in turn, with all
    headings. The prior has no weight: it has been wrong.

    Parameters
    ----------
    last : shape (3,)
        The last believed pose.
    radius
        Of the first disc and the widest [m].
    starts
        In each disc.
    enough
        Share of all beams that the map must explain; unknown places do not count as found.
    """

    def __init__(self, last: F64, radius: tuple[float, float], starts: int, enough: float) -> None:
        self._last = last
        self._radius = radius
        self._starts = starts
        self._enough = enough
        self._candidate: Candidate | None = None
        self.scans = 0
        self.quality = 0.0  # of the last try

    def try_scan(self, chart: Map, scan: Scan, prior: F64, twist: F64 | None, settings: Settings) -> Found | None:
        """Return where the robot is, once a second scan agrees."""
        self.scans += 1
        if self._candidate is not None:
            found = self._candidate.confirm(chart, scan, prior, twist, settings)
            self._candidate = None
            self.quality = found.explained()
            if self.quality >= self._enough:
                return found
        first, widest = self._radius
        radius = min(widest, first * (1.0 + _GROWTH * self.scans))
        centre = prior if self.scans % 2 else self._last
        starts = around(centre, radius, math.pi, self._starts)
        found = discover(chart, scan, starts, twist, settings)
        self.quality = found.explained()
        if self.quality >= self._enough:
            self._candidate = Candidate(found.pose, prior)
        return None
