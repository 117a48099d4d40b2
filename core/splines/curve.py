"""B-spline curves of any dimension on evenly spaced knots."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotwork.core.errors import InputError
from knotwork.core.splines import curve_kernels, fitting, refinement, storage
from knotwork.core.splines.knots import even_knots, index_shift
from knotwork.core.splines.uniform import F64, UniformBasis, inside


class Curve:
    """A function s(tau) = sum of c_i b_i(tau) from a parameter to dim-dimensional points, (4.4).

    It is defined on `domain`, NaN elsewhere; each piece lies in the convex hull of the degree + 1
    control points that act on it.

    Parameters
    ----------
    control
        Control points (n, dim), n > degree; float32 stays float32, all else becomes float64.
    basis
        Degree, first knot and knot interval; or give `step`, `origin`, `degree`.
    weights
        (n,) how much evidence each control point carries, for `merge`; ones unless told.

    Raises
    ------
    InputError
        For too few control points or another shape.
    """

    def __init__(
        self,
        control: ArrayLike,
        basis: UniformBasis | None = None,
        *,
        step: float = 1.0,
        origin: float = 0.0,
        degree: int = 3,
        weights: ArrayLike | None = None,
    ) -> None:
        points = np.asarray(control)
        dtype = np.float32 if points.dtype == np.float32 else np.float64
        self.control: NDArray[Any] = np.array(points, dtype, order="C")
        self.basis = basis or UniformBasis(degree, origin, step)
        if self.control.ndim != 2 or len(self.control) <= self.basis.degree:
            raise InputError(
                f"control points of shape {self.control.shape}: expected (n, dim), n > degree {self.basis.degree}"
            )
        self.weights = fitting.checked(1.0 if weights is None else weights, (len(self.control),), "weights")

    @property
    def domain(self) -> tuple[float, float]:
        """First and last parameter."""
        return self.basis.domain(len(self.control))

    # Evaluation

    def __call__(self, tau: ArrayLike) -> F64:
        """Return the points (n, dim) at tau (n,), or (dim,) at one tau; NaN outside the domain."""
        flat, basis = _flat(tau), self.basis
        if basis.degree == 3:
            out = np.empty((len(flat), self.control.shape[1]))
            curve_kernels.cubic_points(self.control, basis.origin, basis.step, flat, out)
        else:
            out = self._derivatives(flat, 0)
        return out if len(flat) != 1 or np.ndim(tau) else out[0]

    def with_derivative(self, tau: ArrayLike) -> tuple[F64, F64]:
        """Return points and first derivatives with respect to tau, shaped as by a call."""
        flat, basis = _flat(tau), self.basis
        if basis.degree == 3:
            out, slopes = np.empty((len(flat), self.control.shape[1])), np.empty((len(flat), self.control.shape[1]))
            curve_kernels.cubic_slopes(self.control, basis.origin, basis.step, flat, out, slopes)
        else:
            out, slopes = self._derivatives(flat, 0), self._derivatives(flat, 1)
        return (out, slopes) if len(flat) != 1 or np.ndim(tau) else (out[0], slopes[0])

    def derivative(self, tau: ArrayLike, order: int = 1) -> F64:
        """Return the `order`-th derivative with respect to tau, shaped as by a call; zeros above the degree."""
        flat = _flat(tau)
        out = self._derivatives(flat, order)
        return out if len(flat) != 1 or np.ndim(tau) else out[0]

    def _derivatives(self, flat: F64, order: int) -> F64:
        basis = self.basis
        return curve_kernels.derivatives(self.control, basis.origin, basis.step, basis.degree, order, flat)

    # Measures

    def length(self, start: float | None = None, end: float | None = None, tolerance: float = 1e-9) -> float:
        """Return the arc length from `start` to `end` (the whole domain unless told).

        Gauss's rule in each knot interval, with more nodes until the sum changes by less than
        `tolerance` times itself (at most 256 nodes an interval, for curves with cusps).
        """
        low, high = self.domain
        a, b = low if start is None else start, high if end is None else end
        inside(self.basis, np.array([a, b]), len(self.control))
        knots = self.basis.knots(len(self.control))
        edges = np.concatenate(([min(a, b)], knots[(knots > min(a, b)) & (knots < max(a, b))], [max(a, b)]))
        sign, last, nodes = (1.0 if b >= a else -1.0), np.inf, 8
        while True:
            total = float(self._pieces_length(edges, nodes).sum())
            if abs(total - last) <= tolerance * total or nodes >= 256:
                return sign * total
            last, nodes = total, nodes * 2

    def _pieces_length(self, edges: F64, nodes: int) -> F64:
        places, factors = np.polynomial.legendre.leggauss(nodes)
        half = 0.5 * np.diff(edges)
        tau = (edges[:-1] + half)[:, None] + half[:, None] * places
        speed = np.linalg.norm(self.derivative(np.clip(tau, *self.domain).ravel()), axis=1).reshape(tau.shape)
        return np.asarray(half * (speed @ factors))

    def at_length(self, lengths: ArrayLike) -> F64:
        """Return the parameters at which the arc length from the start reaches `lengths` (n,), clipped to the curve.

        Accurate to 1e-9 of the length, less where the curve all but stops (a cusp).
        """
        wanted = np.atleast_1d(np.asarray(lengths, np.float64))
        low, high = self.domain
        edges = np.linspace(low, high, 4 * (len(self.control) - self.basis.degree) + 1)
        reached = np.concatenate(([0.0], np.cumsum(self._pieces_length(edges, 16))))
        wanted = np.clip(wanted, 0.0, reached[-1])
        piece = np.clip(np.searchsorted(reached, wanted, side="right") - 1, 0, len(edges) - 2)
        start = edges[piece]
        tau = np.interp(wanted, reached, edges)
        places, factors = np.polynomial.legendre.leggauss(16)
        for _ in range(8):  # Newton, each step with the length integrated anew inside the piece
            half = 0.5 * (tau - start)
            nodes = np.clip((start + half)[:, None] + half[:, None] * places, low, high)
            speeds = np.linalg.norm(self.derivative(nodes.ravel()), axis=1).reshape(nodes.shape)
            gap = reached[piece] + half * (speeds @ factors) - wanted
            speed = np.linalg.norm(self.derivative(tau), axis=1)
            tau = np.clip(tau - gap / np.maximum(speed, 1e-12), start, edges[piece + 1])
        return tau

    def nearest(self, points: ArrayLike) -> tuple[F64, F64]:
        """Return parameters (n,) and distances (n,) of the curve points nearest to `points` (n, dim)."""
        queries = np.ascontiguousarray(points, np.float64)
        if queries.ndim != 2 or queries.shape[1] != self.control.shape[1]:
            raise InputError(f"points of shape {queries.shape}: expected (n, {self.control.shape[1]})")
        return curve_kernels.nearest(self.control, self.basis.origin, self.basis.step, self.basis.degree, queries)

    def roughness(self, order: int = 2) -> float:
        """Return the integral over the domain of the squared `order`-th derivative, exact."""
        control = self.control.astype(np.float64)
        return float(np.sum(control * (self.basis.gram(len(control), order) @ control)))

    # Change

    def update(self, tau: ArrayLike, amounts: ArrayLike) -> None:
        """Move the curve at tau (n,) by `amounts` (n, dim) with the least change of control points, (7.14).

        In one pass: where parameters share control points their changes add up. InputError outside the domain.
        """
        flat = inside(self.basis, _flat(tau), len(self.control))
        steps = fitting.checked(amounts, (len(flat), self.control.shape[1]), "amounts")
        curve_kernels.add(self.control, self.basis.origin, self.basis.step, self.basis.degree, flat, steps)

    def extend(self, before: int = 0, after: int = 0) -> None:
        """Insert control points at either end, copies of the end ones with weight zero; existing knots stay."""
        pad = ((before, after), (0, 0))
        self.control = np.pad(self.control, pad, mode="edge")
        self.weights = np.pad(self.weights, (before, after))
        self.basis = replace(self.basis, origin=self.basis.origin - before * self.basis.step)

    def merge(self, other: "Curve", limit: float = np.inf) -> "Curve":
        """Return the weighted union with a curve on the same knots: (alpha_a s_a + alpha_b s_b) / (alpha_a + alpha_b).

        Theorem 6.1 and Table 6.1, mended: control points are averaged with the weights of the two where
        both exist and taken as they are elsewhere; weights add up, to at most `limit`.

        Raises
        ------
        InputError
            If knots or dimensions differ, or the two leave a gap between their control points.
        """
        shift = index_shift(self.basis, other.basis)
        if other.control.shape[1] != self.control.shape[1]:
            raise InputError(f"dimensions differ: {self.control.shape[1]} and {other.control.shape[1]}")
        n, m = len(self.control), len(other.control)
        if shift >= n or shift + m <= 0:
            raise InputError(f"no common part: control points 0 to {n - 1} and {shift} to {shift + m - 1}")
        low, high = min(0, shift), max(n, shift + m)
        sums = np.zeros((high - low, self.control.shape[1]))
        weights = np.zeros(high - low)
        plain = np.zeros_like(sums)  # where no weight is left the last one given counts
        for start, curve in ((-low, self), (shift - low, other)):
            part = slice(start, start + len(curve.control))
            sums[part] += curve.weights[:, None] * curve.control
            weights[part] += curve.weights
            plain[part] = curve.control
        control = np.where(weights[:, None] > 0, sums / np.maximum(weights, 1e-300)[:, None], plain)
        basis = replace(self.basis, origin=self.basis.origin + low * self.basis.step)
        return Curve(control.astype(self.control.dtype), basis, weights=np.minimum(weights, limit))

    def refine(self, factor: int = 2) -> "Curve":
        """Return the same curve on knots `factor` times denser."""
        first, control = refinement.refine_control(self.control, self.basis.degree, factor)
        fine = self.basis.refined(factor)
        basis = replace(fine, origin=fine.origin + first * fine.step)
        return Curve(control.astype(self.control.dtype), basis)

    def coarsen(self, factor: int = 2) -> "Curve":
        """Return the curve on knots `factor` times sparser whose refinement is nearest to this one.

        Nearest in the sum of squares over control points; undoes `refine` exactly. Its domain begins with
        this one's and covers it.
        """
        control = refinement.coarsen_control(self.control, self.basis.degree, factor)
        step = self.basis.step
        origin = self.basis.origin - self.basis.degree * (factor - 1) * step
        basis = replace(self.basis, origin=origin, step=step * factor)
        return Curve(control.astype(self.control.dtype), basis)

    def copy(self) -> "Curve":
        """Return an independent copy."""
        return Curve(self.control, self.basis, weights=self.weights)

    # Other representations

    @classmethod
    def fit(
        cls,
        tau: ArrayLike,
        values: ArrayLike,
        step: float,
        *,
        degree: int = 3,
        domain: tuple[float, float] | None = None,
        smoothness: float = 0.0,
        weights: ArrayLike | None = None,
    ) -> "Curve":
        """Fit scattered data by least squares: banded normal equations, (6.10) mended.

        Parameters
        ----------
        tau, values
            Parameters (k,), in any order, and points (k, dim), or (k,) for a scalar function.
        step, degree
            Knot interval and degree. The domain begins at its lower end and is a whole number of intervals.
        domain
            What the curve must cover; the range of tau unless told.
        smoothness
            Factor of the integral of the squared second derivative (the first one for degree 1), added to
            the sum of weighted squared residuals.
        weights
            (k,), one each unless told.

        Raises
        ------
        InputError
            For data that do not determine all control points while `smoothness` is 0, or not finite.
        """
        where = np.ascontiguousarray(tau, np.float64)
        points = np.asarray(values, np.float64)
        points = points[:, None] if points.ndim == 1 else points
        if where.ndim != 1 or not len(where) or points.ndim != 2:
            raise InputError(f"tau {where.shape}, values {points.shape}: expected (k,) and (k, dim), k > 0")
        where = fitting.checked(where, where.shape, "tau")
        points = fitting.checked(points, (len(where), points.shape[1]), "values")
        w = fitting.checked(1.0 if weights is None else weights, where.shape, "weights")
        low, high = domain or (float(where.min()), float(where.max()))
        pieces = max(int(np.ceil((high - low) / step - 1e-9)), 1)
        basis = UniformBasis(degree, low - degree * step, step)
        where = inside(basis, where, pieces + degree)
        return cls(fitting.fit_curve(basis, pieces + degree, where, points, w, smoothness), basis)

    @classmethod
    def through(cls, points: ArrayLike, *, degree: int = 3, step: float = 1.0) -> "Curve":
        """Return the smoothest curve through `points` (k, dim) at parameters 0, step, 2 step, ...

        Of all curves on these knots through the points, the one with the least integral of the squared
        second derivative (natural spline); the first derivative for degree 1.
        """
        targets = np.asarray(points, np.float64)
        if targets.ndim != 2 or len(targets) < 2:
            raise InputError(f"points of shape {targets.shape}: expected (k, dim), k > 1")
        basis = UniformBasis(degree, -degree * step, step)
        return cls(fitting.interpolate(basis, targets), basis)

    def to_scipy(self) -> Any:
        """Return a `scipy.interpolate.BSpline`, equal on the domain; beyond it SciPy extrapolates."""
        from scipy.interpolate import BSpline

        return BSpline(self.basis.knots(len(self.control)), self.control.astype(np.float64), self.basis.degree)

    @classmethod
    def from_scipy(cls, spline: Any) -> "Curve":
        """Build from a `BSpline` whose knots inside its base interval are evenly spaced.

        End knots may be repeated (clamped): the same function on the base interval results, exact to rounding.

        Raises
        ------
        InputError
            For uneven knots.
        """
        d = int(spline.k)
        control = np.asarray(spline.c, np.float64)
        control = control.reshape(len(control), -1)[: len(spline.t) - d - 1]
        origin, step = even_knots(spline.t[d : len(spline.t) - d])
        basis = UniformBasis(d, origin - d * step, step)
        if np.allclose(spline.t, basis.knots(len(control)), rtol=0, atol=1e-9 * step):
            return cls(control, basis)
        pieces = len(control) - d
        inner = (np.arange(d + 1) + 0.5) / (d + 1)  # values inside each interval determine its polynomial
        tau = (origin + step * (np.arange(pieces)[:, None] + inner)).ravel()
        values = np.asarray(spline(tau)).reshape(len(tau), -1)
        return cls(fitting.solve_exactly(basis.matrix(tau, len(control)), values), basis)

    def save(self, path: Path | str) -> None:
        """Write as .npz, bit for bit."""
        basis = np.array([self.basis.degree, self.basis.origin, self.basis.step])
        storage.write(path, "curve", basis=basis, control=self.control, weights=self.weights)

    @classmethod
    def load(cls, path: Path | str) -> "Curve":
        """Read what `save` wrote; InputError names the file if it is anything else."""
        basis, control, weights = storage.read(path, "curve", "basis", "control", "weights")
        degree, origin, step = basis.tolist()
        return cls(control, UniformBasis(int(degree), origin, step), weights=weights)


def _flat(tau: ArrayLike) -> F64:
    flat = np.ascontiguousarray(tau, np.float64)  # of one number: (1,)
    if flat.ndim != 1:
        raise InputError(f"parameters of shape {flat.shape}: expected (n,) or one number")
    return flat
