"""From coarse to fine, from one start or many."""

import math
from dataclasses import dataclass

import numpy as np

from knotwork.core.contracts import Alignment, Map, NormalEquations
from knotwork.core.geometry import wrap
from knotwork.core.messages import F64, Scan
from knotwork.plugins.localizers.gauss_newton.solver import Settings, Solution, prior_cost, solve
from knotwork.plugins.localizers.gauss_newton.starts import around

_REFINED = 4  # starts that are solved at the coarsest level, the cheapest of all
_PROMISING = 8  # starts that are solved because the map explains most there
_NEAR = (0.3, 0.1)  # [m, rad] around those, where finer starts are tried
_STARTS_NEAR = 200
_APART = (0.5, 0.3)  # [m, rad] between poses that are two places
_CLEAR = 0.15  # by so much more of the scan the right place of several is explained
_NOTHING = np.zeros((3, 3))


@dataclass(frozen=True, slots=True)
class Found:
    """Where the descent ended: the pose, the scan's equations there at the finest level, the prepared scan."""

    pose: F64
    equations: NormalEquations
    alignment: Alignment

    @property
    def known(self) -> float:
        """Share of the beams with a return that met the map, in [0, 1]."""
        return self.equations.n_used / max(self.equations.n_total, 1)

    def explained(self) -> float:
        """Return the share of all beams with a return that the map explains, in [0, 1].

        Asked of the second finest level, since the finest can be too strict by centimetres, and of the finest.
        """
        if not self.equations.n_total:
            return 0.0
        finest = self.alignment.levels - 1
        return max(self.alignment.inliers(self.pose, level) for level in (max(finest - 1, 0), finest))

    def quality(self) -> float:
        """Return the share of the beams that met the map which the map explains, in [0, 1]."""
        return min(1.0, self.explained() / self.known) if self.known else 0.0


def descend(
    chart: Map, scan: Scan, starts: F64, prior: F64, information: F64, twist: F64 | None, settings: Settings
) -> Found:
    """Solve from the coarsest level to the finest.

    Parameters
    ----------
    starts : shape (k, 3)
        The cheapest of several are solved at the coarsest level and the best result is taken on.
    prior, information : shape (3,), (3, 3)
        The prior's term of the cost. A finer level starts from the coarser one's result, and where the prior
        costs less than that also from the prior: a coarse level may slide where a fine one would not.
    twist
        For de-skewing; None: not.
    """
    loss, scale = settings.loss, settings.scale
    alignment = chart.alignment(scan, starts[0], twist)
    solution: Solution | None = None
    for start in _cheapest(alignment, starts, prior, information, settings):
        tried = solve(alignment, 0, start, prior, information, settings)
        if solution is None or tried.cost < solution.cost:
            solution = tried
    assert solution is not None
    if len(starts) > 1:
        alignment = chart.alignment(scan, solution.pose, twist)
    for level in range(1, alignment.levels):
        here = alignment.normal_equations(solution.pose, level, loss, scale)
        there = alignment.costs(prior[None], level, loss, scale)[0]
        slid = there < here.cost + prior_cost(solution.pose, prior, information)
        solution = solve(alignment, level, solution.pose, prior, information, settings, here)
        if slid:
            other = solve(alignment, level, prior, prior, information, settings)
            if other.cost < solution.cost:
                solution = other
    return _found(solution, alignment)


@dataclass(frozen=True, slots=True)
class Discovered:
    """Where the map explains the largest share of a scan, and how much it explains elsewhere at most, in [0, 1]."""

    best: Found
    rival: float

    def convinces(self, enough: float) -> bool:
        """Return whether the map explains `enough` there, and no other place looks much the same, as in a corridor."""
        return self.best.explained() >= max(enough, self.rival + _CLEAR)


def discover(chart: Map, scan: Scan, starts: F64, twist: F64 | None, settings: Settings) -> Discovered:
    """Solve without a prior, and return the pose at which the map explains the largest share of the scan.

    The cost alone does not tell where a robot has been before: walls that were seen once cost more than a few
    strong ones that half of the beams miss.

    Parameters
    ----------
    starts : shape (k, 3)
        The cheapest and those that explain most are solved.
    """
    rough = chart.alignment(scan, starts[0], twist)
    level = min(1, rough.levels - 1)
    near = np.concatenate([around(start, *_NEAR, _STARTS_NEAR) for start in _best_explained(rough, starts, 0)])
    tries = [(level, start) for start in _best_explained(rough, near, level)]
    tries += [(0, start) for start in _cheapest(rough, starts, starts[0], _NOTHING, settings)]
    found = [_refined(chart.alignment(scan, start, twist), first, start, settings) for first, start in tries]
    best = max(found, key=Found.explained)
    others = [other.explained() for other in found if _apart(best.pose, other.pose)]
    return Discovered(best, max(others, default=0.0))


def _apart(a: F64, b: F64) -> bool:
    far, turn = _APART
    return math.dist(a[:2], b[:2]) > far or abs(wrap(float(a[2] - b[2]))) > turn


def _refined(alignment: Alignment, level: int, start: F64, settings: Settings) -> Found:
    """Solve from `level` to the finest, from `start` (3,) and without a prior."""
    solution = solve(alignment, level, start, start, _NOTHING, settings)
    for finer in range(level + 1, alignment.levels):
        solution = solve(alignment, finer, solution.pose, solution.pose, _NOTHING, settings)
    return _found(solution, alignment)


def _found(solution: Solution, alignment: Alignment) -> Found:
    x, y, yaw = solution.pose.tolist()
    return Found(np.array([x, y, wrap(yaw)]), solution.equations, alignment)


def _best_explained(alignment: Alignment, starts: F64, level: int) -> F64:
    """Return the few starts at which the map explains most of the scan, the best first."""
    shares = np.array([alignment.inliers(start, level) for start in starts])
    return starts[np.argsort(-shares, kind="stable")[:_PROMISING]]


def _cheapest(alignment: Alignment, starts: F64, prior: F64, information: F64, settings: Settings) -> F64:
    """Return the few starts of lowest cost, the lowest first."""
    if len(starts) == 1:
        return starts
    costs = alignment.costs(starts, 0, settings.loss, settings.scale)
    for k, start in enumerate(starts):
        costs[k] += prior_cost(start, prior, information)
    return starts[np.argsort(costs, kind="stable")[:_REFINED]]
