"""One scan against the surfaces of a map."""

import numpy as np

from knotwork.core.beams import Beams
from knotwork.core.contracts import Alignment, Loss, NormalEquations
from knotwork.core.messages import F64
from knotwork.core.robust import CODES
from knotwork.core.splines import TiledArray
from knotwork.plugins.maps.spline_surface import kernels


class SurfaceAlignment(Alignment):
    """A prepared scan; holds on to the map's surfaces, so it sees what is fused meanwhile.

    Parameters
    ----------
    beams
        The scan in the robot's frame.
    surfaces, steps
        Control points and knot interval [m] of each level.
    clamp, sigma
        Of the residual (1 - s / clamp) / sigma; clamp in the unit of the control points.
    explained
        In the same unit: a beam that ends where the surface is higher is explained by the map.
    most
        More beams than this count as this many.
    """

    def __init__(
        self,
        beams: Beams,
        surfaces: list[TiledArray],
        steps: tuple[float, ...],
        clamp: float,
        sigma: float,
        explained: float,
        most: float,
    ) -> None:
        self.beams = beams
        self.levels = len(steps)
        self._points = beams.points
        self._n = len(beams.points)
        self._surfaces = surfaces
        self._steps = steps
        self._clamp = clamp
        self._sigma = sigma
        self._explained = explained
        self._weight = min(1.0, most / self._n) if self._n else 1.0

    def normal_equations(self, pose: F64, level: int, loss: Loss = "none", scale: float = 1.0) -> NormalEquations:
        """Return H, g and cost at `pose` (3,) in one pass, (7.22) with the signs of the errata."""
        out = np.empty((4, 3))
        cost, used = kernels.normal_equations(
            *self._surfaces[level].arrays(), self._steps[level], self._points, pose,
            self._clamp, self._sigma, self._weight, CODES[loss], scale, out,
        )  # fmt: skip
        return NormalEquations(out[:3], out[3], cost, used, self._n)

    def costs(self, poses: F64, level: int, loss: Loss = "none", scale: float = 1.0) -> F64:
        """Return the cost at each of `poses` (k, 3): shape (k,)."""
        return kernels.costs(
            *self._surfaces[level].arrays(), self._steps[level], self._points, poses,
            self._clamp, self._sigma, self._weight, CODES[loss], scale,
        )  # fmt: skip

    def residuals(self, pose: F64, level: int) -> tuple[F64, F64]:
        """Return whitened residuals (n,) and their Jacobian (n, 3)."""
        residuals = np.empty(self._n)
        rows = np.empty((self._n, 3))
        kernels.jacobian(
            *self._surfaces[level].arrays(), self._steps[level], self._points, pose,
            self._clamp, self._sigma, self._weight, residuals, rows,
        )  # fmt: skip
        return residuals, rows

    def inliers(self, pose: F64, level: int) -> float:
        """Return the share of beams with a return that end where the surface says occupied, in [0, 1]."""
        if not self._n:
            return 0.0
        arrays = self._surfaces[level].arrays()
        return kernels.explained(*arrays, self._steps[level], self._points, pose, self._explained) / self._n
