"""A scan into the curves of one level: fit, merge, extend, join, begin."""

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from knotwork.core.messages import F64
from knotwork.core.splines import Curve
from knotwork.plugins.maps.spline_curve.association import Association
from knotwork.plugins.maps.spline_curve.offset import estimate_offset, moved_to_lattice
from knotwork.plugins.maps.spline_curve.segmentation import Clusters
from knotwork.plugins.maps.spline_curve.store import CurveStore

_END = 1.5  # knot intervals: a run that ends this near to its curve's end may extend it
_SHORTEST = 0.5  # knot intervals: data on less do not determine a curve
_PROVEN = 3.0  # scans: where this many stand behind a curve, no other may bend it
_DENSITY = 4.0  # points in a knot interval that make the evidence of a whole scan


@dataclass(slots=True)
class Fused:
    """What a scan did to a level: lengths [m] and counts."""

    overlap: float = 0.0  # of the scan's clusters with curves
    new: float = 0.0  # the rest of its clusters
    begun: int = 0
    joined: int = 0


@dataclass(frozen=True, slots=True)
class _Stretch:
    """Points begin to end - 1 of a cluster; on the run, or on none (-1)."""

    begin: int
    end: int
    run: int


class Fusion:
    """One scan's work on one level.

    Parameters
    ----------
    store
        The level; changed at the end of `apply`.
    gate
        Distance [m] up to which points lie on a curve.
    smoothness, limit, least
        Of a fit; most evidence of a control point [scans]; fewest points of a new curve.
    """

    def __init__(self, store: CurveStore, gate: float, smoothness: float, limit: float, least: int) -> None:
        self._store = store
        self._gate = gate
        self._smoothness = smoothness
        self._limit = limit
        self._least = least
        self._changed: dict[int, Curve] = {}
        self._gone: set[int] = set()
        self._moved: dict[int, tuple[int, float]] = {}  # joined curve: the one it is part of now, and its shift [m]
        self._begun: list[Curve] = []
        self.result = Fused()

    def apply(self, clusters: Clusters, points: F64, found: Association, behind: NDArray[np.bool_]) -> Fused:
        """Fuse map points (m, 2) of `clusters` as they were `found` on the curves.

        Of what lies on none, and `behind` (m,) walls, nothing is drawn: either the wall is not there any more and
        will be forgotten first, or the pose is wrong.
        """
        for k in range(len(clusters.starts) - 1):
            begin, end = int(clusters.starts[k]), int(clusters.starts[k + 1])
            stretches = [
                each
                for each in self._stretches(found, k, begin, end)
                if each.run >= 0 or 2 * np.count_nonzero(behind[each.begin : each.end]) <= each.end - each.begin
            ]
            self._cluster(clusters.chord, points, found, stretches)
        replaced: dict[int, list[Curve]] = {number: [curve] for number, curve in self._changed.items()}
        replaced |= {number: [] for number in self._gone}
        self._store.change(replaced, self._begun)
        self.result.begun = len(self._begun)
        return self.result

    @staticmethod
    def _stretches(found: Association, cluster: int, begin: int, end: int) -> list[_Stretch]:
        out, at = [], begin
        for number in np.flatnonzero(found.runs[:, 4] == cluster).tolist():
            first, last = int(found.runs[number, 0]), int(found.runs[number, 1])
            if first > at:
                out.append(_Stretch(at, first, -1))
            out.append(_Stretch(first, last, number))
            at = last
        if end > at:
            out.append(_Stretch(at, end, -1))
        return out

    def _cluster(self, chord: F64, points: F64, found: Association, stretches: list[_Stretch]) -> None:
        taken = [False] * len(stretches)
        step = self._store.step
        for n, stretch in enumerate(stretches):
            if stretch.run < 0:
                continue
            on = np.flatnonzero(found.run[stretch.begin : stretch.end] == stretch.run) + stretch.begin
            number, shift = self._current(int(found.runs[stretch.run, 2]))
            curve = self._curve(number)
            self.result.overlap += float(chord[on[-1]] - chord[on[0]])
            tau = found.feet[on] * step + shift
            low, high = curve.domain
            parts, where = [tau], [on]
            if n and stretches[n - 1].run < 0 and not taken[n - 1] and tau[0] - low < _END * step:
                before = np.arange(stretches[n - 1].begin, stretches[n - 1].end)
                parts.insert(0, tau[0] + chord[before] - chord[on[0]])
                where.insert(0, before)
                taken[n - 1] = True
            if n + 1 < len(stretches) and stretches[n + 1].run < 0 and high - tau[-1] < _END * step:
                after = np.arange(stretches[n + 1].begin, stretches[n + 1].end)
                parts.append(tau[-1] + chord[after] - chord[on[-1]])
                where.append(after)
                taken[n + 1] = True
            tau = np.concatenate(parts)
            if float(np.ptp(tau)) < _SHORTEST * step:
                continue
            piece = self._fit(tau, points[np.concatenate(where)])
            self._changed[number] = curve.merge(piece, self._limit)
        for n, stretch in enumerate(stretches):
            if stretch.run < 0 and not taken[n] and stretch.end - stretch.begin >= self._least:
                part = slice(stretch.begin, stretch.end)
                length = float(chord[stretch.end - 1] - chord[stretch.begin])
                if length < _SHORTEST * step:
                    continue
                self.result.new += length
                self._begun.append(self._fit(chord[part] - chord[stretch.begin], points[part]))
        runs = [stretch for stretch in stretches if stretch.run >= 0]
        for a, b in itertools.pairwise(runs):
            self._join(chord, found, a, b)

    def _current(self, number: int) -> tuple[int, float]:
        """Return where curve `number` of the store is now, and by how much its parameter was raised [m]."""
        shift = 0.0
        while number in self._moved:
            number, more = self._moved[number]
            shift += more
        return number, shift

    def _curve(self, number: int) -> Curve:
        return self._changed.get(number) or self._store.curve(number)

    def _fit(self, tau: F64, points: F64) -> Curve:
        """Return the curve through points (k, 2) at tau (k,) [m], its weights the evidence of one scan at most."""
        step = self._store.step
        low, high = np.floor(tau.min() / step + 1e-9), np.ceil(tau.max() / step - 1e-9)
        high = max(high, low + 1)
        curve = Curve.fit(
            np.clip(tau, low * step, high * step), points, step, domain=(low * step, high * step),
            smoothness=self._smoothness * step**3,
        )  # fmt: skip
        basis = replace(curve.basis, origin=(low - 3) * step)
        first, shares = basis.weights(np.clip(tau, low * step, high * step - 1e-9 * step))
        mass = np.zeros(len(curve.control) + 1)
        for k in range(4):
            np.add.at(mass, np.clip(first + k, 0, len(mass) - 1), shares[:, k])
        return Curve(curve.control, basis, weights=np.minimum(mass[:-1] / _DENSITY, 1.0))

    def _join(self, chord: F64, found: Association, a: _Stretch, b: _Stretch) -> None:
        """Make one curve of two that a cluster shows to be one: the first one's end meets the second one's begin."""
        step = self._store.step
        first, shift_a = self._current(int(found.runs[a.run, 2]))
        second, shift_b = self._current(int(found.runs[b.run, 2]))
        if first == second:
            return
        one, two = self._curve(first), self._curve(second)
        on_a = np.flatnonzero(found.run[a.begin : a.end] == a.run) + a.begin
        on_b = np.flatnonzero(found.run[b.begin : b.end] == b.run) + b.begin
        end_a = found.feet[on_a[-1]] * step + shift_a
        begin_b = found.feet[on_b[0]] * step + shift_b
        between = float(chord[on_b[0]] - chord[on_a[-1]])
        beyond = one.domain[1] - end_a - between  # how far the first curve reaches beyond the second one's begin
        if begin_b - two.domain[0] > _END * step + max(beyond, 0.0) or beyond < -_END * step:
            return
        shift = end_a + between - begin_b
        better = estimate_offset(one, two, shift)
        if better is not None and better[1] < 0.5 * step and abs(better[0] - shift) < step:
            shift = better[0]
        moved = moved_to_lattice(two, shift, self._smoothness)
        gap = (moved.basis.origin - one.basis.origin) / step - len(one.control)
        if gap >= 0:
            return
        joint = one.merge(moved, self._limit)
        if max(_bent(one, joint), _bent(moved, joint)) > max(self._gate, step):
            self._drop_copy(first, one, second, two)
            return
        self._changed[first] = joint
        self._drop(second, first, shift)
        self.result.joined += 1

    def _drop(self, number: int, other: int, shift: float) -> None:
        """Forget a curve whose places are on `other` now, at parameters raised by `shift` [m]."""
        self._changed.pop(number, None)
        self._gone.add(number)
        self._moved[number] = (other, shift)

    def _drop_copy(self, first: int, one: Curve, second: int, two: Curve) -> None:
        """Of two curves that cannot be joined, forget the one with less evidence if all of it lies on the other."""
        if one.weights.sum() < two.weights.sum():
            first, one, second, two = second, two, first, one
        tau = _knots(two)
        there, distance = one.nearest(two(tau))
        if distance.max() <= self._gate:
            self._drop(second, first, float(np.median(there - tau)))


def _knots(curve: Curve) -> F64:
    """Return the parameters at the ends of the curve's knot intervals."""
    return curve.basis.knots(len(curve.control))[curve.basis.degree : -curve.basis.degree]


def _bent(part: Curve, joint: Curve) -> float:
    """Return how far [m] `part` was moved at most where several scans stand behind it, in a curve it is part of now."""
    tau = _knots(part)
    moved = joint(np.clip(tau, *joint.domain)) - part(tau)
    proven = part.weights[1 : len(tau) + 1] >= _PROVEN  # of the control point that has most to say at a knot
    return float(np.max(np.hypot(moved[:, 0], moved[:, 1]), where=proven, initial=0.0))
