"""One adapter for each library: the same control points and knots, the same points, the same outputs.

An adapter is built from curve control points (m, 2) or surface control points (m, m), first knot and
knot interval, and has some of: `curve(tau)` -> (n, 2), `curve_d(tau)` -> both, `surface(points)` -> (n,),
`surface_d(points)` -> (n,), (n, 2). Whatever can be prepared once is prepared in the constructor.
"""

import importlib
from functools import cached_property

import numpy as np

from knotwork.core.splines import Curve, Surface

D = 3


class Library:
    """What all adapters know."""

    name = ""
    needs = ""

    def __init__(self, control: np.ndarray, origin: float, step: float) -> None:
        self.control, self.origin, self.step = control, origin, step
        self.knots = origin + step * np.arange(len(control) + D + 1)


class Knotwork(Library):
    name = "knotwork, float64"
    dtype: type = np.float64

    @cached_property
    def curve(self):
        return Curve(self.control.astype(self.dtype), origin=self.origin, step=self.step)

    @property
    def curve_d(self):
        return self.curve.with_derivative

    @cached_property
    def surface(self):
        return Surface.from_control(self.control.astype(self.dtype), self.step, origin=(self.origin, self.origin))

    @property
    def surface_d(self):
        return self.surface.with_gradient


class KnotworkSingle(Knotwork):
    name = "knotwork, float32"
    dtype = np.float32


class Thesis(Library):
    """The thesis's Algorithms 1 and 2 in vectorised NumPy: indices, weights, 4 or 16 products a point."""

    name = "the thesis's way in NumPy"

    def weights(self, tau):
        quotient = (tau - self.origin) / self.step
        mu = np.floor(quotient)
        t = quotient - mu
        t2 = t * t
        t3 = t2 * t
        b = np.empty((len(tau), 4))
        b[:, 0] = (-t3 + 3 * t2 - 3 * t + 1) / 6
        b[:, 1] = (3 * t3 - 6 * t2 + 4) / 6
        b[:, 2] = (-3 * t3 + 3 * t2 + 3 * t + 1) / 6
        b[:, 3] = t3 / 6
        return mu.astype(np.int64) - D, b, t, t2

    def slopes(self, t, t2):
        d = np.empty((len(t), 4))
        d[:, 0] = -t2 + 2 * t - 1
        d[:, 1] = 3 * t2 - 4 * t
        d[:, 2] = -3 * t2 + 2 * t + 1
        d[:, 3] = t2
        return d / (2 * self.step)

    def curve(self, tau):
        first, b, _, _ = self.weights(tau)
        return np.einsum("ni,nic->nc", b, self.control[first[:, None] + np.arange(4)])

    def curve_d(self, tau):
        first, b, t, t2 = self.weights(tau)
        c = self.control[first[:, None] + np.arange(4)]
        return np.einsum("ni,nic->nc", b, c), np.einsum("ni,nic->nc", self.slopes(t, t2), c)

    def patch(self, i, j):
        rows = (i[:, None] + np.arange(4)) * self.control.shape[1]
        index = rows[:, :, None] + (j[:, None] + np.arange(4))[:, None, :]
        return np.take(self.control, index.reshape(-1, 16))

    @staticmethod
    def tensor(a, b):
        return (a[:, :, None] * b[:, None, :]).reshape(-1, 16)

    def surface(self, points):
        i, bx, _, _ = self.weights(points[:, 0])
        j, by, _, _ = self.weights(points[:, 1])
        return np.einsum("nk,nk->n", self.tensor(bx, by), self.patch(i, j))

    def surface_d(self, points):
        i, bx, tx, tx2 = self.weights(points[:, 0])
        j, by, ty, ty2 = self.weights(points[:, 1])
        c = self.patch(i, j)
        gradient = np.empty((len(points), 2))
        gradient[:, 0] = np.einsum("nk,nk->n", self.tensor(self.slopes(tx, tx2), by), c)
        gradient[:, 1] = np.einsum("nk,nk->n", self.tensor(bx, self.slopes(ty, ty2)), c)
        return np.einsum("nk,nk->n", self.tensor(bx, by), c), gradient


class Splipy(Library):
    name = "Splipy"
    needs = "splipy"

    def __init__(self, control, origin, step):
        super().__init__(control, origin, step)
        import splipy

        basis = splipy.BSplineBasis(D + 1, self.knots)
        if control.shape[1] == 2:
            self.object = splipy.Curve(basis, control)
        else:
            flat = control.T.reshape(-1, 1)  # its control points run along u first
            self.object = splipy.Surface(basis, splipy.BSplineBasis(D + 1, self.knots), flat)

    def curve(self, tau):
        return self.object.evaluate(tau)

    def curve_d(self, tau):
        return self.object.evaluate(tau), self.object.derivative(tau)

    def surface(self, points):
        return self.object.evaluate(points[:, 0], points[:, 1], tensor=False)[:, 0]

    def surface_d(self, points):
        u, v = points.T
        partials = [self.object.derivative(u, v, d=d, tensor=False)[:, 0] for d in ((1, 0), (0, 1))]
        return self.surface(points), np.stack(partials, axis=1)


class Geomdl(Library):
    name = "NURBS-Python (geomdl)"
    needs = "geomdl"

    def __init__(self, control, origin, step):
        super().__init__(control, origin, step)
        from geomdl import BSpline

        if control.shape[1] == 2:
            self.object = BSpline.Curve(normalize_kv=False)
            self.object.degree = D
            self.object.ctrlpts = control.tolist()
            self.object.knotvector = self.knots.tolist()
        else:
            self.object = BSpline.Surface(normalize_kv=False)
            self.object.degree_u = self.object.degree_v = D
            self.object.set_ctrlpts([[0.0, 0.0, z] for z in control.ravel().tolist()], *control.shape)
            self.object.knotvector_u = self.object.knotvector_v = self.knots.tolist()

    def curve(self, tau):
        return np.array(self.object.evaluate_list(tau.tolist()))

    def curve_d(self, tau):
        both = np.array([self.object.derivatives(t, 1) for t in tau.tolist()])
        return both[:, 0], both[:, 1]

    def surface(self, points):
        return np.array(self.object.evaluate_list(points.tolist()))[:, 2]

    def surface_d(self, points):
        jets = [self.object.derivatives(u, v, 1) for u, v in points.tolist()]
        return np.array([j[0][0][2] for j in jets]), np.array([[j[1][0][2], j[0][1][2]] for j in jets])


class Bspline(Library):
    name = "bspline"
    needs = "bspline"

    def __init__(self, control, origin, step):
        super().__init__(control, origin, step)
        self.fresh()

    def fresh(self):
        """Forget what it remembers of every point it ever saw."""
        import bspline

        self.basis = bspline.Bspline(self.knots, D)

    def curve(self, tau):
        self.fresh()
        return np.array([self.basis(t) for t in tau]) @ self.control

    def curve_d(self, tau):
        point = self.curve(tau)
        return point, np.array([self.basis.d(t) for t in tau]) @ self.control

    def rows(self, points):
        self.fresh()
        return (np.array([self.basis(t) for t in column]) for column in points.T)

    def surface(self, points):
        x, y = self.rows(points)
        return np.einsum("ni,ni->n", x @ self.control, y)

    def surface_d(self, points):
        x, y = self.rows(points)
        dx, dy = (np.array([self.basis.d(t) for t in column]) for column in points.T)
        along = x @ self.control
        gradient = np.stack((np.einsum("ni,ni->n", dx @ self.control, y), np.einsum("ni,ni->n", along, dy)), 1)
        return np.einsum("ni,ni->n", along, y), gradient


class ScipyBSpline(Library):
    name = "SciPy BSpline / NdBSpline"

    @cached_property
    def object(self):
        from scipy.interpolate import BSpline, NdBSpline

        if self.control.shape[1] == 2:
            spline = BSpline(self.knots, self.control, D)
            return spline, spline.derivative()
        return (NdBSpline((self.knots, self.knots), self.control, D),)

    def curve(self, tau):
        return self.object[0](tau)

    def curve_d(self, tau):
        return self.object[0](tau), self.object[1](tau)

    def surface(self, points):
        return self.object[0](points)

    def surface_d(self, points):
        spline = self.object[0]
        return spline(points), np.stack((spline(points, nu=(1, 0)), spline(points, nu=(0, 1))), 1)


class ScipyRect(Library):
    name = "SciPy RectBivariateSpline.ev"

    @cached_property
    def object(self):
        from scipy.interpolate import BivariateSpline

        return BivariateSpline._from_tck((self.knots, self.knots, self.control.ravel(), D, D))

    def surface(self, points):
        return self.object.ev(points[:, 0], points[:, 1])

    def surface_d(self, points):
        x, y = points.T
        partials = self.object.ev(x, y, dx=1), self.object.ev(x, y, dy=1)
        return self.object.ev(x, y), np.stack(partials, 1)


class ScipyMap(Library):
    """No derivatives: central differences, four more calls."""

    name = "SciPy map_coordinates"
    tolerance = 1e-4

    def surface(self, points):
        from scipy.ndimage import map_coordinates

        place = (points.T - self.origin) / self.step - 2.0  # sample k is the peak of function k
        return map_coordinates(self.control, place, order=3, prefilter=False)

    def surface_d(self, points):
        h = 1e-5
        gradient = np.empty((len(points), 2))
        for axis, shift in enumerate(np.eye(2) * h):
            gradient[:, axis] = (self.surface(points + shift) - self.surface(points - shift)) / (2 * h)
        return self.surface(points), gradient


class Ndsplines(Library):
    name = "ndsplines"
    needs = "ndsplines"

    @cached_property
    def object(self):
        from ndsplines import NDSpline

        if self.control.shape[1] == 2:
            return NDSpline([self.knots], self.control, D)
        return NDSpline([self.knots, self.knots], self.control, D)

    def curve(self, tau):
        return self.object(tau)

    def curve_d(self, tau):
        return self.object(tau), self.object(tau, nus=1)

    def surface(self, points):
        return self.object(points)

    def surface_d(self, points):
        both = self.object(points, nus=np.array([1, 0])), self.object(points, nus=np.array([0, 1]))
        return self.object(points), np.stack(both, 1)


class Interpolation(Library):
    """Numba too; asked through its kernels, results allocated in the call."""

    name = "interpolation.py"
    needs = "interpolation"

    def __init__(self, control, origin, step):
        super().__init__(control, origin, step)
        from interpolation.splines import eval_cubic_numba

        self.kernels = eval_cubic_numba
        dim = 1 if control.shape[1] == 2 else 2
        self.low = np.full(dim, origin + D * step)
        self.high = np.full(dim, origin + len(control) * step)
        self.orders = np.full(dim, len(control) - 2)
        self.single = np.ascontiguousarray(control[..., None])

    def curve(self, tau):
        out = np.empty((len(tau), 2))
        self.kernels.vec_eval_cubic_splines_1(self.low, self.high, self.orders, self.control, tau[:, None], out)
        return out

    def curve_d(self, tau):
        out, slopes = np.empty((len(tau), 2)), np.empty((len(tau), 1, 2))
        kernel = self.kernels.vec_eval_cubic_splines_G_1
        kernel(self.low, self.high, self.orders, self.control, tau[:, None], out, slopes)
        return out, slopes[:, 0]

    def surface(self, points):
        out = np.empty(len(points))
        self.kernels.vec_eval_cubic_spline_2(self.low, self.high, self.orders, self.control, points, out)
        return out

    def surface_d(self, points):
        out, gradient = np.empty((len(points), 1)), np.empty((len(points), 2, 1))
        kernel = self.kernels.vec_eval_cubic_splines_G_2
        kernel(self.low, self.high, self.orders, self.single, points, out, gradient)
        return out[:, 0], gradient[:, :, 0]


OURS = (KnotworkSingle, Knotwork)
PEERS = (
    Thesis, Splipy, Geomdl, Bspline, ScipyBSpline, ScipyRect, ScipyMap, Ndsplines, Interpolation,
)  # fmt: skip


def installed() -> tuple[list[type[Library]], dict[str, str]]:
    """Return the libraries that import here, and why the others do not."""
    good, missing = [*OURS], {}
    for library in PEERS:
        try:
            if library.needs:
                importlib.import_module(library.needs)
            good.append(library)
        except Exception as error:  # noqa: BLE001 a peer that does not work here is reported
            missing[library.name] = f"{type(error).__name__}: {error}"
    return good, missing
