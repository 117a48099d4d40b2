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
_KNOWN = 0.5  # of the beams: if more meet the map, those that do not say nothing of where odometry leads
_GROWTH = 0.25  # of the first radius, a scan


@dataclass(frozen=True, slots=True)
class Candidate:
    """Where one scan may have been taken: pose (3,), and the prior (3,) of that scan."""

    pose: F64
    prior: F64

    def confirm(self, chart: Map, scan: Scan, prior: F64, twist: F64 | None, settings: Settings) -> Found:
        """Return the best pose near here for a later scan, whose prior says how the robot has moved since."""
        moved = np.array(compose(self.pose.tolist(), relative(self.prior.tolist(), prior.tolist())))
        return discover(chart, scan, around(moved, *_NEAR, _CONFIRMING), twist, settings).best


class Search:
    """One search, from the scan that was lost to the two in a row that agree on a place.

    Where odometry says that the robot is it may only have been surrounded by what the map does not know: there
    the map has to explain no more than of any scan. Elsewhere it has to explain `enough`, and much more than
    at any other place. Starts lie in a growing disc, around the prior and around the last believed pose in turn,
    with all headings. The prior has no weight: it has been wrong.

    Parameters
    ----------
    last : shape (3,)
        The last believed pose.
    radius
        Of the first disc and the widest [m].
    starts
        In each disc.
    believed, enough
        Share of the beams that the map must explain: where odometry says that the robot is, of those that meet
        the map; elsewhere of all, so that unknown places do not count as found.
    """

    def __init__(self, last: F64, radius: tuple[float, float], starts: int, believed: float, enough: float) -> None:
        self._last = last
        self._radius = radius
        self._starts = starts
        self._believed = believed
        self._enough = enough
        self._candidate: Candidate | None = None
        self._here = 0  # scans in a row that the map explains where odometry says that they were taken
        self.scans = 0
        self.quality = 0.0  # of the last try

    def try_scan(self, chart: Map, scan: Scan, prior: F64, twist: F64 | None, settings: Settings) -> Found | None:
        """Return where the robot is, once a second scan agrees."""
        self.scans += 1
        here = Candidate(prior, prior).confirm(chart, scan, prior, twist, settings)
        self.quality = here.quality() if here.known >= _KNOWN else here.explained()
        self._here = self._here + 1 if self.quality >= self._believed else 0
        if self._here > 1:
            return here
        if self._candidate is not None:
            found = self._candidate.confirm(chart, scan, prior, twist, settings)
            self._candidate = None
            self.quality = max(self.quality, found.explained())
            if found.explained() >= self._enough:
                return found
        first, widest = self._radius
        radius = min(widest, first * (1.0 + _GROWTH * self.scans))
        centre = prior if self.scans % 2 else self._last
        starts = around(centre, radius, math.pi, self._starts)
        discovered = discover(chart, scan, starts, twist, settings)
        self.quality = max(self.quality, discovered.best.explained())
        if discovered.convinces(self._enough):
            self._candidate = Candidate(discovered.best.pose, prior)
        return None
