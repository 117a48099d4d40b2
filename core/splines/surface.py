"""B-spline surfaces without borders: control points in tiles, allocated where the surface is touched."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from knotwork.core.errors import InputError
from knotwork.core.splines import batch, storage, surface_kernels
from knotwork.core.splines.fitting import fit_surface, penalty_terms
from knotwork.core.splines.knots import even_knots, index_shift
from knotwork.core.splines.refinement import coarsen_surface, refine_surface
from knotwork.core.splines.tiles import SIDE, TiledArray
from knotwork.core.splines.uniform import F64, UniformBasis

Box = tuple[int, int, int, int]


class Surface:
    """A scalar function of the plane, s(x, y) = sum of C[i, j] b_i(x) b_j(y), (4.16) mended.

    Control points exist for all integer indices; those never written hold `fill`. Evaluation costs the
    same however large the surface is. Coordinates in metres, say; values in any unit.

    Parameters
    ----------
    step
        Knot interval: one number, or one along x and one along y.
    origin
        First knots (x, y); function (0, 0) is supported from there on.
    degree
        1 to 5, the same along x and y; 3 is fastest.
    dtype
        float32 or float64 control points; sums are made in float64.
    fill
        Value of untouched control points, and so of the surface there.

    Raises
    ------
    InputError
        For a degree, an interval or a type out of range.
    """

    def __init__(
        self,
        step: float | tuple[float, float] = 1.0,
        *,
        origin: tuple[float, float] = (0.0, 0.0),
        degree: int = 3,
        dtype: DTypeLike = np.float32,
        fill: float = 0.0,
    ) -> None:
        if np.dtype(dtype) not in (np.dtype(np.float32), np.dtype(np.float64)):
            raise InputError(f"control points of type {np.dtype(dtype)}: expected float32 or float64")
        sx, sy = step if isinstance(step, tuple) else (step, step)
        self.along = UniformBasis(degree, float(origin[0]), float(sx))
        self.across = UniformBasis(degree, float(origin[1]), float(sy))
        self.degree = degree
        self.control = TiledArray(dtype, fill)
        self._knots = (self.along.origin, self.across.origin, self.along.step, self.across.step)

    # Evaluation

    def __call__(self, points: ArrayLike) -> F64:
        """Return the values (n,) at `points` (n, 2); NaN where a coordinate is."""
        rows = _rows(points)
        if self.degree == 3:
            return surface_kernels.cubic_values(*self.control.arrays(), *self._knots, rows)
        return self._jets(rows, 0)[:, 0]

    def with_gradient(self, points: ArrayLike) -> tuple[F64, F64]:
        """Return values (n,) and partial derivatives (n, 2) at `points` (n, 2), (4.17) mended."""
        rows = _rows(points)
        if self.degree == 3:
            values, gradients = np.empty(len(rows)), np.empty((len(rows), 2))
            batch.cubic_gradients(*self.control.arrays(), *self._knots, rows, values, gradients)
            return values, gradients
        jets = self._jets(rows, 1)
        return jets[:, 0], jets[:, 1:]

    def with_hessian(self, points: ArrayLike) -> tuple[F64, F64, F64]:
        """Return values (n,), first (n, 2) and second partial derivatives (n, 2, 2) at `points` (n, 2)."""
        jets = self._jets(_rows(points), 2)
        return jets[:, 0], jets[:, 1:3], jets[:, [3, 4, 4, 5]].reshape(-1, 2, 2)

    def at(self, x: float, y: float) -> tuple[float, float, float]:
        """Return value and both partial derivatives at one point: the call for a control loop."""
        if self.degree == 3:
            return surface_kernels.cubic_at(*self.control.arrays(), *self._knots, x, y)
        value, gx, gy = self._jets(np.array([[x, y]]), 1)[0]
        return float(value), float(gx), float(gy)

    def _jets(self, rows: F64, order: int) -> F64:
        return surface_kernels.jets(*self.control.arrays(), *self._knots, self.degree, order, rows)

    # Change

    def update(self, points: ArrayLike, amounts: ArrayLike, low: float = -np.inf, high: float = np.inf) -> None:
        """Raise the surface at `points` (n, 2) by `amounts` (n,) with the least change of control points.

        Equation (7.14), applied in one pass: where points share control points their changes add up.
        Control points are kept within [low, high], (7.15).

        Raises
        ------
        InputError
            For points that are not finite or a different number of amounts.
        """
        rows = _rows(points)
        steps = np.ascontiguousarray(np.broadcast_to(np.asarray(amounts, np.float64), (len(rows),)))
        self.reserve(rows)
        if self.degree == 3:
            surface_kernels.cubic_update(*self.control.arrays(), *self._knots, rows, steps, low, high)
        else:
            surface_kernels.update(*self.control.arrays(), *self._knots, self.degree, rows, steps, low, high)

    def reserve(self, points: ArrayLike) -> None:
        """Allocate the tiles of all control points that act at `points` (n, 2)."""
        rows = _rows(points)
        if not np.isfinite(rows).all():
            raise InputError(f"{int((~np.isfinite(rows).all(axis=1)).sum())} of {len(rows)} points are not finite")
        self.control.reserve_patches(surface_kernels.patches(*self._knots, self.degree, rows), self.degree + 1)

    def merge(self, other: "Surface", weight: float = 1.0, other_weight: float = 1.0) -> None:
        """Average with a surface of the same knots: where both have tiles, control points are weighted.

        The result is the weighted mean of both surfaces (Theorem 6.1, mended) wherever both have all
        their control points; tiles that only one of them has are taken as they are.

        Raises
        ------
        InputError
            If the knots of the two do not lie on each other.
        """
        di, dj = self.offset_of(other)
        share = other_weight / (weight + other_weight)
        known = self.control.used
        where, tiles = other.control.claimed()
        for (ti, tj), tile in zip(where.tolist(), tiles, strict=True):
            self.control.blend_block(ti * SIDE + di, tj * SIDE + dj, tile, share, known)

    def offset_of(self, other: "Surface") -> tuple[int, int]:
        """Return the index here of control point (0, 0) of `other`; an error if knots do not match."""
        shifts = []
        for mine, theirs in ((self.along, other.along), (self.across, other.across)):
            shifts.append(index_shift(mine, theirs))
        return shifts[0], shifts[1]

    def refine(self, factor: int = 2) -> "Surface":
        """Return the same function on knots `factor` times denser."""
        return self._resampled(refine_surface(self.control, self.degree, factor), factor)

    def coarsen(self, factor: int = 2) -> "Surface":
        """Return the function on knots `factor` times sparser whose refinement is nearest to this one.

        Nearest in the sum of squares over control points; undoes `refine` exactly. Works on the dense
        bounding box of the claimed tiles.
        """
        return self._resampled(coarsen_surface(self.control, self.degree, factor), 1 / factor)

    def _resampled(self, control: TiledArray, factor: float) -> "Surface":
        made = Surface(
            (self.along.step / factor, self.across.step / factor),
            origin=(self.along.origin, self.across.origin),
            degree=self.degree,
            dtype=self.control.dtype,
            fill=self.control.fill,
        )
        made.control = control
        return made

    def copy(self) -> "Surface":
        """Return an independent copy."""
        return self._resampled(self.control.copy(), 1)

    # Measures

    @property
    def nbytes(self) -> int:
        """Bytes held by control points and their directory."""
        return self.control.nbytes

    def roughness(self, order: int = 2) -> float:
        """Return the integral over the plane of all squared `order`-th derivatives (thin-plate energy for 2).

        s_x^2 + s_y^2 for 1, s_xx^2 + 2 s_xy^2 + s_yy^2 for 2; exact. Works on the dense bounding box.
        """
        i0, j0, i1, j1 = self.control.bounds()
        if i0 == i1:
            return 0.0
        d = self.degree  # a rim of untouched control points closes the support
        c = self.control.block(i0 - d, j0 - d, i1 + d, j1 + d).astype(np.float64) - self.control.fill
        terms = penalty_terms(self.along, self.across, c.shape[0], c.shape[1], order)
        return float(sum(factor * np.sum(c * (a @ c @ b)) for factor, a, b in terms))

    # Other representations

    @classmethod
    def from_control(
        cls,
        control: ArrayLike,
        step: float | tuple[float, float] = 1.0,
        *,
        first: tuple[int, int] = (0, 0),
        origin: tuple[float, float] = (0.0, 0.0),
        degree: int = 3,
        fill: float = 0.0,
    ) -> "Surface":
        """Build from a dense array of control points (n, m), float32 or float64, the first with index `first`."""
        values = np.asarray(control)
        if values.ndim != 2:
            raise InputError(f"control points of shape {values.shape}: expected (n, m)")
        dtype = np.float32 if values.dtype == np.float32 else np.float64
        made = cls(step, origin=origin, degree=degree, dtype=dtype, fill=fill)
        made.control.write_block(*first, values)
        return made

    def to_scipy(self, box: Box | None = None) -> Any:
        """Return a `scipy.interpolate.NdBSpline` of control points [i0, i1) x [j0, j1), all claimed tiles unless told.

        Equal on the domain of those control points; beyond it SciPy extrapolates.
        """
        from scipy.interpolate import NdBSpline

        i0, j0, i1, j1 = box or self.control.bounds()
        if i1 - i0 <= self.degree or j1 - j0 <= self.degree:
            raise InputError(f"box {(i0, j0, i1, j1)}: needs more than {self.degree} control points each way")
        block = self.control.block(i0, j0, i1, j1).astype(np.float64)
        x = self.along.knots(i1 - i0) + i0 * self.along.step
        y = self.across.knots(j1 - j0) + j0 * self.across.step
        return NdBSpline((x, y), block, self.degree)

    @classmethod
    def from_scipy(cls, spline: Any, dtype: DTypeLike = np.float64) -> "Surface":
        """Build from a two-dimensional `NdBSpline` with evenly spaced knots and one degree.

        Raises
        ------
        InputError
            For uneven (clamped, say) knots, more dimensions, two degrees.
        """
        if len(spline.t) != 2 or spline.c.ndim != 2 or spline.k[0] != spline.k[1]:
            raise InputError("expected a scalar NdBSpline of two variables and one degree")
        (ox, sx), (oy, sy) = (even_knots(knots) for knots in spline.t)
        made = cls((sx, sy), origin=(ox, oy), degree=int(spline.k[0]), dtype=dtype)
        made.control.write_block(0, 0, np.asarray(spline.c))
        return made

    @classmethod
    def fit(
        cls,
        points: ArrayLike,
        values: ArrayLike,
        step: float | tuple[float, float],
        *,
        origin: tuple[float, float] = (0.0, 0.0),
        degree: int = 3,
        smoothness: float = 0.0,
        weights: ArrayLike | None = None,
        dtype: DTypeLike = np.float64,
    ) -> "Surface":
        """Fit scattered data by least squares: sparse normal equations over the data's bounding box.

        Parameters
        ----------
        points, values
            (n, 2) and (n,).
        step, origin, degree, dtype
            As of the surface.
        smoothness
            Factor of the integral of squared second derivatives (first ones for degree 1), added to the
            sum of weighted squared residuals. Above zero it also fills regions without data.
        weights
            (n,), one each unless told.

        Raises
        ------
        InputError
            For data that do not determine all control points while `smoothness` is 0, or not finite.
        """
        made = cls(step, origin=origin, degree=degree, dtype=dtype)
        first, block = fit_surface(made.along, made.across, _rows(points), values, weights, smoothness)
        made.control.write_block(*first, block)
        return made

    def save(self, path: Path | str) -> None:
        """Write as .npz: only claimed tiles, bit for bit."""
        where, tiles = self.control.claimed()
        knots, fill = np.array(self._knots), np.array(self.control.fill)
        storage.write(path, "surface", degree=np.array(self.degree), knots=knots, fill=fill, where=where, tiles=tiles)

    @classmethod
    def load(cls, path: Path | str) -> "Surface":
        """Read what `save` wrote; InputError names the file if it is anything else."""
        degree, knots, fill, where, tiles = storage.read(path, "surface", "degree", "knots", "fill", "where", "tiles")
        ox, oy, sx, sy = knots.tolist()
        made = cls((sx, sy), origin=(ox, oy), degree=int(degree), dtype=tiles.dtype, fill=float(fill))
        made.control = TiledArray.from_claimed(where, tiles, float(fill))
        return made


def _rows(points: ArrayLike) -> F64:
    """Return points as rows (n, 2), float64, contiguous."""
    rows = np.ascontiguousarray(points, np.float64)
    if rows.ndim != 2 or rows.shape[1] != 2:
        raise InputError(f"points of shape {rows.shape}: expected (n, 2)")
    return rows
