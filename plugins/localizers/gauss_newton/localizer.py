"""The localiser `gauss-newton`."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from knotwork.core.contracts import Alignment, Context, Localizer, Map, NormalEquations, Prior, PriorEstimate
from knotwork.core.geometry import compose, relative, wrap
from knotwork.core.messages import F64, Pose, Scan
from knotwork.plugins.localizers.gauss_newton import GaussNewtonConfig
from knotwork.plugins.localizers.gauss_newton.solver import Settings, Solution, posterior, prior_cost, propose, solve
from knotwork.plugins.localizers.gauss_newton.starts import around
from knotwork.plugins.localizers.gauss_newton.uncertainty import MapUncertainty

_REFINED = 4  # starts of a search that are solved, the best by cost
_WEAK_STARTS = 40
_AGREE = 0.3  # [m] a prior this near the pose has taken it over
_NOTHING = np.zeros((3, 3))
_LOOSE = np.diag([0.04, 0.04, 0.04])


@dataclass(frozen=True, slots=True)
class Found:
    """A pose, the scan's equations there, the prior's information in it, the prepared scan."""

    pose: F64
    equations: NormalEquations
    information: F64
    alignment: Any


class GaussNewton(Localizer):
    """Finds the pose at which the map explains a scan best, near the prior.

    Works with every map through its `Alignment`. Each level starts from the coarser level's result or the
    prior, whichever costs less; the coarsest tries more starts when the prior is weak. The pose is
    published with prior and scan in it, and the scan's information alone beside it.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        config: GaussNewtonConfig = context.config
        self.config = config
        self._map: Map | None = None
        self._settings = Settings(
            config.loss, config.scale, config.iterations, config.tolerance, config.settle, config.damping
        )
        self._uncertainty = MapUncertainty(config.inflation)
        self._last = np.zeros(3)  # last believed pose
        self._last_prior = np.zeros(3)  # and the prior of its scan
        self._fused_at: F64 | None = None
        self._quality = math.nan
        self._doubtful = 0  # scans in a row
        self._lost = False
        self._settling = False  # found again, but the prior has not taken it over yet
        self._pending: tuple[F64, F64] | None = None  # found once: pose and prior
        self._searches = 0
        self._lost_scans = 0
        self._doubtful_scans = 0

    def warm(self) -> None:
        """Compile the solver."""
        pose, out = np.zeros(3), np.zeros(3)
        equations = np.zeros((4, 3))
        prior_cost(pose, out, np.eye(3))
        propose(pose, equations[:3], equations[3], pose, np.eye(3), 0.1, out)
        posterior(pose, np.eye(3), out, np.eye(3), np.empty((3, 3)), out)
        MapUncertainty(1.0).warm()

    def statistics(self) -> dict[str, float]:
        """Return the counts of lost and doubtful scans."""
        return {"lost_scans": self._lost_scans, "doubtful_scans": self._doubtful_scans}

    def on_scan(self, scan: Scan) -> None:
        """Localise a scan, publish its pose, fuse it if it is believed."""
        chart: Map = self.context.uses["map"]
        estimate = self._prior(scan)
        prior = np.array(estimate.pose, np.float64)
        if chart.empty():
            self._uncertainty.begin(prior, np.asarray(estimate.covariance, np.float64))
            self._publish(scan, _unaided(prior, estimate.covariance), math.nan, estimate.covariance)
            self._believe(prior, prior)
            self._fuse(chart, scan, prior, None)
            return
        with self.context.measure("align"):
            twist = estimate.twist if self.config.deskew else None
            if self._lost:
                found = self._search(chart, scan, prior, twist)
            else:
                found = self._track(chart, scan, prior, estimate, twist)
        if found is None:
            self._lost_scans += 1
            self._publish(scan, _unaided(prior, estimate.covariance), self._quality, estimate.covariance, lost=True)
            return
        self._publish(scan, found, self._quality, estimate.covariance)
        self._believe(found.pose, prior)
        if not self._doubtful:
            self._fuse(chart, scan, found.pose, found.alignment)

    # Tracking

    def _track(
        self, chart: Map, scan: Scan, prior: F64, estimate: PriorEstimate, twist: F64 | None
    ) -> Found | None:
        """Return the pose near the prior; None once too many scans in a row were doubtful."""
        covariance = np.asarray(estimate.covariance, np.float64)
        information = np.linalg.inv(covariance)
        starts = prior[None]
        if self._settling:
            moved = compose(self._last.tolist(), relative(self._last_prior.tolist(), prior.tolist()))
            starts = np.array([prior, moved])
            information = _NOTHING
        if estimate.weak or self._settling:
            reach, turn = self.config.weak
            starts = np.concatenate([around(start, reach, turn, _WEAK_STARTS) for start in starts])
        found = self._descend(chart, scan, starts, prior, information, twist)
        if self._settling:
            self._settling = math.dist(found.pose[:2], prior[:2]) > _AGREE
        equations = found.equations
        if equations.n_used < self.config.known * max(equations.n_total, 1) or equations.n_total == 0:
            self._quality = math.nan
            return _unaided(prior, covariance, found.alignment)
        self._quality = self._measure(found)
        if self._quality >= self.config.doubt:
            self._doubtful = 0
            return found
        self._doubtful += 1
        self._doubtful_scans += 1
        if self._doubtful < self.config.lost_after:
            return _unaided(prior, covariance, found.alignment)
        self._lost = True
        self._searches = 0
        self._pending = None
        self.context.report("warning", "lost: the map does not explain the scans; nothing is fused until found")
        return None

    def _descend(
        self, chart: Map, scan: Scan, starts: F64, prior: F64, information: F64, twist: F64 | None
    ) -> Found:
        """Solve from coarse to fine; the coarsest level takes the best of `starts` (k, 3)."""
        settings = self._settings
        loss, scale = settings.loss, settings.scale
        alignment = chart.alignment(scan, prior, twist)
        pose = prior
        if len(starts) > 1:
            costs = alignment.costs(starts, 0, loss, scale)
            totals = [c + prior_cost(p, prior, information) for c, p in zip(costs, starts, strict=True)]
            best: tuple[float, F64] | None = None
            for k in np.argsort(totals, kind="stable")[:_REFINED]:
                tried = solve(alignment, 0, starts[k], prior, information, settings)
                if best is None or tried.cost < best[0]:
                    best = tried.cost, tried.pose
            assert best is not None
            pose = best[1]
            alignment = chart.alignment(scan, pose, twist)
        solution: Solution | None = None
        for level in range(0 if len(starts) == 1 else 1, alignment.levels):
            if solution is not None or len(starts) > 1:
                at_pose, at_prior = alignment.costs(np.array([pose, prior]), level, loss, scale)
                if at_prior < at_pose + prior_cost(pose, prior, information):
                    pose = prior
            solution = solve(alignment, level, pose, prior, information, settings)
            pose = solution.pose
        if solution is None:
            solution = solve(alignment, 0, pose, prior, information, settings)
        pose = np.array([pose[0], pose[1], wrap(float(pose[2]))])
        return Found(pose, solution.equations, information, alignment)

    def _measure(self, found: Found) -> float:
        """Return the share of the beams that met the map which the map explains."""
        equations = found.equations
        level = max(found.alignment.levels - 2, 0)  # tolerant of the finest level's centimetres
        share = found.alignment.inliers(found.pose, level) * equations.n_total / max(equations.n_used, 1)
        return min(1.0, share)

    # Lost

    def _search(self, chart: Map, scan: Scan, prior: F64, twist: F64 | None) -> Found | None:
        """Return the pose where two scans in a row found the robot, else None."""
        config = self.config
        self._searches += 1
        alone = _NOTHING
        if self._pending is not None:
            pose, then = self._pending
            moved = np.array(compose(pose.tolist(), relative(then.tolist(), prior.tolist())))
            again = self._descend(chart, scan, around(moved, 0.2, 0.2, _WEAK_STARTS), moved, alone, twist)
            self._pending = None
            self._quality = self._strict(again)
            if self._quality >= config.found:
                self._lost = False
                self._doubtful = 0
                self._settling = True
                self.context.report("info", f"found again after {self._searches} scans")
                return again
        narrow, wide = config.search
        radius = min(wide, narrow * (1.0 + 0.25 * self._searches))
        centre = prior if self._searches % 2 else self._last
        starts = around(centre, radius, math.pi, config.starts)
        found = self._descend(chart, scan, starts, centre, alone, twist)
        self._quality = self._strict(found)
        if self._quality >= config.found:
            self._pending = found.pose, prior
        return None

    def _strict(self, found: Found) -> float:
        """Return the share of all beams that the map explains: unknown places do not count as found."""
        if not found.equations.n_total:
            return 0.0
        return found.alignment.inliers(found.pose, max(found.alignment.levels - 2, 0))

    # What is told

    def _believe(self, pose: F64, prior: F64) -> None:
        self._last = pose
        self._last_prior = prior

    def _fuse(self, chart: Map, scan: Scan, pose: F64, alignment: Alignment | None) -> None:
        """Fuse a believed scan if the robot has moved since the last fused one."""
        at = self._fused_at
        far, turn = self.config.fuse_motion
        fuse = at is None or (
            math.hypot(pose[0] - at[0], pose[1] - at[1]) >= far or abs(wrap(float(pose[2] - at[2]))) >= turn
        )
        with self.context.measure("update"):
            chart.update(scan, pose, alignment, fuse)
        if fuse:
            self._fused_at = pose
            self._uncertainty.remember(scan, pose)

    def _publish(self, scan: Scan, found: Found, quality: float, prior: F64, *, lost: bool = False) -> None:
        H = found.equations.H
        local, scan_pose = np.empty((3, 3)), np.empty(3)
        posterior(found.pose, H, found.equations.g, found.information, local, scan_pose)
        covariance = self._uncertainty.follow(scan, found.pose, prior, found.information, H, local)
        self.context.emit(
            "pose",
            Pose(
                stamp=scan.stamp,
                role="estimate",
                pose=found.pose,
                covariance=covariance,
                scan_id=scan.scan_id,
                quality=quality,
                lost=lost,
                scan_pose=scan_pose,
                scan_information=H,
                prior_included=True,
                local_covariance=local,
            ),
        )

    def _prior(self, scan: Scan) -> PriorEstimate:
        prior: Prior | None = self.context.uses.get("prior")
        if prior is not None:
            return prior.prior(scan.stamp)
        return PriorEstimate(self._last, _LOOSE, np.zeros(3), weak=False)


def _unaided(prior: F64, covariance: F64, alignment: Alignment | None = None) -> Found:
    """Return the prior as a result to which no scan has contributed."""
    nothing = NormalEquations(_NOTHING, np.zeros(3), 0.0, 0, 0)
    return Found(prior, nothing, np.linalg.inv(covariance), alignment)
