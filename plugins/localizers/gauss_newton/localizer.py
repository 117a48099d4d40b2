"""The localiser `gauss-newton`."""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from knotwork.core.contracts import Alignment, Context, Localizer, Map, Prior, PriorEstimate
from knotwork.core.geometry import compose, relative, wrap
from knotwork.core.messages import F64, Pose, Scan
from knotwork.plugins.localizers.gauss_newton import GaussNewtonConfig
from knotwork.plugins.localizers.gauss_newton.descent import Found, descend, discover
from knotwork.plugins.localizers.gauss_newton.search import Candidate, Search
from knotwork.plugins.localizers.gauss_newton.solver import Settings, prior_cost, propose
from knotwork.plugins.localizers.gauss_newton.starts import around
from knotwork.plugins.localizers.gauss_newton.uncertainty import MapUncertainty, scan_alone

_GONE = 1.0  # [s] odometry that has not come for so long will not come
_AGREE = 0.3  # [m] a prior this near the pose has taken it over
_NOTHING = np.zeros((3, 3))
_LOOSE = np.diag([0.04, 0.04, 0.04])  # covariance of a pose that is predicted by nobody


@dataclass(frozen=True, slots=True)
class Belief:
    """The last believed pose (3,) and the prior (3,) of its scan."""

    pose: F64
    prior: F64


class GaussNewton(Localizer):
    """Finds the pose at which the map explains a scan best, near the prior.

    Works with every map through its `Alignment`. The pose is published with the prior in it, and what the
    scan alone says beside it. A scan that the map does not explain (`quality` below `doubt`) leaves the
    prior as it is and is not fused; after `lost_after` of them in a row the robot is lost, until a search
    finds it.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        config: GaussNewtonConfig = context.config
        self.config = config
        self._settings = Settings(
            config.loss, config.scale, config.iterations, config.tolerance, config.settle, config.damping
        )
        self._uncertainty = MapUncertainty(config.inflation)
        self._belief = Belief(np.zeros(3), np.zeros(3))
        self._fused_at: F64 | None = None
        self._quality = math.nan
        self._doubtful = 0  # scans in a row
        self._candidate: Candidate | None = None  # where the last scan, a doubtful one, may have been
        self._search: Search | None = None
        self._waiting: deque[tuple[Scan, int]] = deque()  # with the time when they came [ns]
        self._settling = False  # found again, but the prior has not taken it over yet
        self._counts = {"lost_scans": 0, "doubtful_scans": 0}

    def warm(self) -> None:
        """Compile the solver."""
        pose, out = np.zeros(3), np.zeros(3)
        one = np.eye(3)
        prior_cost(pose, out, one)
        propose(pose, one, out, pose, one, 0.1, out)
        self._uncertainty.warm()

    def statistics(self) -> dict[str, float]:
        """Return the counts of lost and doubtful scans."""
        return dict(self._counts)

    def on_scan(self, scan: Scan) -> None:
        """Localise a scan, and those before it that waited for odometry."""
        self._waiting.append((scan, self.context.now()))
        self._work(self.context.now() - round(self.config.patience * 1e9))

    def finish(self) -> None:
        """Localise the scans that still wait."""
        self._work(self.context.now())

    def _work(self, since: int) -> None:
        """Localise the scans in order, up to one that may wait: it came after `since` [ns].

        A host that pauses gets scans before the odometry of their time. By a guess of the robot's motion they
        would be de-skewed wrongly, and drawn into the map like that.
        """
        while self._waiting:
            scan, came = self._waiting[0]
            estimate = self._predicted(scan)
            if came > since and 0.0 < estimate.ahead <= _GONE:
                return
            self._waiting.popleft()
            self._localise(scan, estimate)

    def _localise(self, scan: Scan, estimate: PriorEstimate) -> None:
        """Publish the pose of a scan, fuse it if it is believed."""
        chart: Map = self.context.uses["map"]
        twist = estimate.twist if self.config.deskew else None
        if chart.empty():
            self._uncertainty.begin(estimate.pose, estimate.covariance)
            self._accept(scan, estimate, None)
            self._fuse(chart, scan, chart.alignment(scan, estimate.pose, twist))
            return
        with self.context.measure("align"):
            if self._search is None:
                found = self._track(chart, scan, estimate, twist)
            else:
                found = self._find(chart, scan, estimate, twist)
        if found is not None:
            self._fuse(chart, scan, found.alignment)

    def _predicted(self, scan: Scan) -> PriorEstimate:
        source: Prior | None = self.context.uses.get("prior")
        if source is None:
            return PriorEstimate(self._belief.pose, _LOOSE, np.zeros(3))
        estimate = source.prior(scan.stamp)
        pose = np.array(estimate.pose, np.float64)
        covariance = np.array(estimate.covariance, np.float64)
        return PriorEstimate(pose, covariance, estimate.twist, estimate.weak, estimate.ahead)

    def _track(self, chart: Map, scan: Scan, estimate: PriorEstimate, twist: F64 | None) -> Found | None:
        """Publish the pose near the prior; return it if the scan may be fused there."""
        config, last, prior = self.config, self._belief, estimate.pose
        information: F64 = np.linalg.inv(estimate.covariance).astype(np.float64)
        starts = prior[None]
        if self._settling:  # the prior may still be where it was lost
            starts = np.array([prior, compose(last.pose.tolist(), relative(last.prior.tolist(), prior.tolist()))])
            information = _NOTHING
        if estimate.weak or self._settling:
            starts = np.concatenate([around(start, *config.weak, config.weak_starts) for start in starts])
        found = descend(chart, scan, starts, prior, information, twist, self._settings)
        candidate, self._candidate = self._candidate, None
        if candidate is not None:
            there = candidate.confirm(chart, scan, prior, twist, self._settings)
            if there.explained() >= max(config.found, found.explained()):  # it was odometry that failed
                found, information = there, _NOTHING
        self._settling = self._settling and math.dist(found.pose[:2], prior[:2]) > _AGREE
        says_something = found.known >= config.known and found.equations.n_total > 0
        self._quality = found.quality() if says_something else math.nan
        if not says_something:
            self._accept(scan, estimate, None)
            return Found(prior, found.equations, found.alignment)
        if self._quality >= config.doubt:
            self._doubtful = 0
            self._accept(scan, estimate, found, information)
            return found
        self._counts["doubtful_scans"] += 1
        again = discover(chart, scan, around(prior, *config.astray, config.astray_starts), twist, self._settings)
        self._doubtful += 1
        if self._doubtful < config.lost_after:
            if again.convinces(config.found):  # one scan may be wrong: the next has to agree
                self._candidate = Candidate(again.best.pose, prior)
            self._accept(scan, estimate, None)
            return None
        self._search = Search(last.pose, config.search, config.starts, config.doubt, config.found)
        self.context.report("warning", "lost: the map does not explain the scans; nothing is fused until found")
        self._publish_lost(scan, estimate)
        return None

    def _find(self, chart: Map, scan: Scan, estimate: PriorEstimate, twist: F64 | None) -> Found | None:
        """Search for a lost robot; publish and return its pose when it is found."""
        assert self._search is not None
        found = self._search.try_scan(chart, scan, estimate.pose, twist, self._settings)
        self._quality = self._search.quality
        if found is None:
            self._publish_lost(scan, estimate)
            return None
        self.context.report("info", f"found again after {self._search.scans} scans")
        self._search = None
        self._doubtful = 0
        self._settling = True
        self._accept(scan, estimate, found)
        return found

    def _accept(self, scan: Scan, estimate: PriorEstimate, found: Found | None, information: F64 = _NOTHING) -> None:
        """Publish and believe a pose: what was found with the prior in it, or the prior alone."""
        self._belief = Belief(estimate.pose if found is None else found.pose, estimate.pose)
        if found is None:
            information = np.linalg.inv(estimate.covariance).astype(np.float64)
        self._emit(scan, estimate, found, information, lost=False)

    def _publish_lost(self, scan: Scan, estimate: PriorEstimate) -> None:
        self._counts["lost_scans"] += 1
        self._emit(scan, estimate, None, np.linalg.inv(estimate.covariance).astype(np.float64), lost=True)

    def _emit(self, scan: Scan, estimate: PriorEstimate, found: Found | None, information: F64, *, lost: bool) -> None:
        pose = estimate.pose if found is None else found.pose
        H, g = (_NOTHING, np.zeros(3)) if found is None else (found.equations.H, found.equations.g)
        local, scan_pose = np.empty((3, 3)), np.empty(3)
        scan_alone(pose, H, g, information, local, scan_pose)
        message = Pose(
            stamp=scan.stamp,
            role="estimate",
            pose=pose,
            covariance=self._uncertainty.follow(scan, pose, estimate.covariance, information, H, local),
            local_covariance=local,
            scan_id=scan.scan_id,
            quality=self._quality,
            lost=lost,
            scan_pose=scan_pose,
            scan_information=H,
            prior_included=True,
        )
        self.context.emit("pose", message)

    def _fuse(self, chart: Map, scan: Scan, alignment: Alignment | None) -> None:
        """Give the scan to the map at the believed pose; it is fused if the robot has moved since the last one."""
        pose, at = self._belief.pose, self._fused_at
        far, turn = self.config.fuse_motion
        moved = (
            at is None
            or math.hypot(pose[0] - at[0], pose[1] - at[1]) >= far
            or abs(wrap(float(pose[2] - at[2]))) >= turn
        )
        with self.context.measure("update"):
            chart.update(scan, pose, alignment, moved)
        if moved:
            self._fused_at = pose
            self._uncertainty.remember(scan, pose)
