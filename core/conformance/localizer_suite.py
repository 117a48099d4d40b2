"""What a localiser must do, tried in a room whose walls are known in closed form."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from knotwork.core.conformance.context import RecordingContext
from knotwork.core.conformance.room import FixedPrior, Room, scan_of
from knotwork.core.conformance.room_map import RoomMap
from knotwork.core.conformance.samples import difference
from knotwork.core.conformance.suite import _ROOM_MAP, NodeSuite
from knotwork.core.messages import F64, Pose, Scan

_PERIOD = 200_000_000  # ns between scans


class LocalizerSuite(NodeSuite):
    """Checks of localisers.

    Attributes
    ----------
    offsets
        Errors of the prior (x [m], y [m], yaw [rad]) that must be recovered, within `tolerance`.
    tolerance
        Of position [m] and yaw [rad].
    lost_after
        So many scans that do not fit make it say lost.
    """

    kind = "localizer"
    offsets: ClassVar[tuple[tuple[float, float, float], ...]] = (
        (0.0, 0.0, 0.0), (0.08, -0.05, 0.03), (-0.1, 0.1, -0.05), (0.0, 0.05, 0.08),
    )  # fmt: skip
    tolerance: ClassVar[tuple[float, float]] = (0.03, 0.02)
    lost_after: ClassVar[int] = 10

    def setting(self, folder: Path) -> tuple[RecordingContext, RoomMap, FixedPrior]:
        """Return a context, its map and its prior."""
        reference = RoomMap(RecordingContext(_ROOM_MAP, out=folder))
        prior = FixedPrior(np.zeros(3))
        uses: dict[str, Any] = {n: reference for n, u in self.manifest.uses.items() if u.protocol == "map"}
        uses |= {n: prior for n, u in self.manifest.uses.items() if u.protocol == "prior"}
        return self.context(folder, uses=uses), reference, prior

    def scan_port(self) -> str:
        """Return the name of the input that takes scans."""
        return self._port({n: p.message for n, p in self.manifest.inputs.items()}, "scan")

    def pose_port(self) -> str:
        """Return the name of the output that gives estimates."""
        return self._port({n: p.message for n, p in self.manifest.outputs.items() if p.role == "estimate"}, "pose")

    @staticmethod
    def _port(ports: dict[str, str], message: str) -> str:
        found = [name for name, type_name in ports.items() if type_name == message]
        return found[0] if found else pytest.fail(f"the manifest has no port for {message}")

    def locate(self, context: RecordingContext, node: Any, prior: FixedPrior, scan: Scan, guess: F64) -> Pose:
        """Give one scan with the prior at `guess` (3,); return the estimate."""
        prior.pose = np.asarray(guess, dtype=float)
        context.give(node, self.scan_port(), scan)
        found: list[Pose] = context.messages(self.pose_port())
        assert found, "no estimate for a scan"
        return found[-1]

    def settled(self, folder: Path) -> tuple[RecordingContext, RoomMap, FixedPrior, Any]:
        """Return a localiser that has seen five scans at their true poses."""
        context, reference, prior = self.setting(folder)
        node = self.node(context)
        for number in range(5):
            self.locate(context, node, prior, _scan(np.zeros(3), number), np.zeros(3))
        return context, reference, prior, node

    def test_recovers_small_offsets(self, tmp_path: Path) -> None:
        """The estimate is nearer to the truth than the prior was, with a covariance and the scan's number."""
        context, _, prior, node = self.settled(tmp_path)
        for number, offset in enumerate(self.offsets, start=5):
            truth = np.array([0.1 * (number - 5), 0.05, 0.1])
            estimate = self.locate(context, node, prior, _scan(truth, number), truth + offset)
            error = estimate.pose - truth
            assert np.hypot(*error[:2]) < self.tolerance[0], f"prior off by {offset}, estimate by {error}"
            assert abs(np.angle(np.exp(1j * error[2]))) < self.tolerance[1], (
                f"prior off by {offset}, estimate by {error}"
            )
            assert not estimate.lost
            assert estimate.scan_id == number
            assert estimate.stamp == number * _PERIOD, "the estimate's stamp is its scan's"
            assert np.isnan(estimate.quality) or 0 <= estimate.quality <= 1
            _check(estimate)
        node.close()

    def test_same_again(self, tmp_path: Path) -> None:
        """Two instances give the same estimates, bit by bit."""
        runs = []
        for name in ("first", "second"):
            context, _, prior, node = self.settled(tmp_path / name)
            self.locate(context, node, prior, _scan(np.array([0.1, 0, 0.05]), 5), np.array([0.05, 0.03, 0.0]))
            runs.append(context.emitted)
        assert len(runs[0]) == len(runs[1])
        for (_, a), (_, b) in zip(*runs, strict=True):
            assert not difference(a, b), difference(a, b)

    def test_poor_scans(self, tmp_path: Path) -> None:
        """Scans without a return, of NaN, of one beam and of none give finite estimates, or none."""
        context, _, prior, node = self.settled(tmp_path)
        prior.pose = np.zeros(3)
        for number, ranges in enumerate([[np.inf] * 90, [np.nan] * 90, [2.0], []], start=5):
            context.give(node, self.scan_port(), scan_of(ranges, stamp=number * _PERIOD, scan_id=number))
        context.give(node, self.scan_port(), _scan(np.zeros(3), 9))
        for estimate in context.messages(self.pose_port()):
            _check(estimate)
        node.finish()
        node.close()

    def test_first_scan(self, tmp_path: Path) -> None:
        """A first scan without a return does not end the run."""
        context, _, _ = self.setting(tmp_path)
        node = self.node(context)
        context.give(node, self.scan_port(), scan_of([np.inf] * 360))
        node.finish()
        node.close()

    def test_says_lost(self, tmp_path: Path) -> None:
        """Scans of another place make it say lost; nothing is fused at a pose it does not believe."""
        context, reference, prior, node = self.settled(tmp_path)
        rng = np.random.default_rng(0)
        for number in range(5, 5 + self.lost_after):
            nowhere = scan_of(rng.uniform(0.4, 1.6, 360), stamp=number * _PERIOD, scan_id=number)
            estimate = self.locate(context, node, prior, nowhere, np.zeros(3))
            _check(estimate)
        assert estimate.lost, f"{self.lost_after} scans that do not fit, quality {estimate.quality}"
        lost = {p.scan_id for p in context.messages(self.pose_port()) if p.lost}
        fused = {scan.scan_id for scan, _, fuse in reference.updates if fuse}
        assert not lost & fused, f"scans {sorted(lost & fused)} were fused at poses it calls lost"
        node.close()


def _scan(truth: F64, number: int) -> Scan:
    return Room().scan(truth, stamp=number * _PERIOD, scan_id=number, noise=0.01)


def _check(estimate: Pose) -> None:
    assert estimate.role == "estimate"
    assert estimate.pose.shape == (3,)
    assert np.all(np.isfinite(estimate.pose)), f"the pose is {estimate.pose}"
    covariance = estimate.covariance
    if covariance is None:
        assert estimate.lost, "an estimate that is believed has a covariance"
        return
    assert covariance.shape == (3, 3)
    assert np.all(np.isfinite(covariance)), "the covariance is not finite"
    scale = max(float(np.abs(covariance).max()), 1e-300)
    assert np.allclose(covariance, covariance.T, rtol=0, atol=1e-9 * scale), "the covariance is not symmetric"
    assert np.linalg.eigvalsh(covariance).min() >= -1e-9 * scale, "the covariance has a negative direction"
