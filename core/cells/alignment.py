"""One scan against the levels of a map of cells."""

from dataclasses import dataclass

import numpy as np

from knotwork.core.beams import Beams
from knotwork.core.cells import kernels
from knotwork.core.contracts import Alignment, Loss, NormalEquations
from knotwork.core.messages import F64
from knotwork.core.robust import CODES
from knotwork.core.splines import TiledArray


@dataclass(frozen=True, slots=True)
class CellLevel:
    """One level as an alignment reads it.

    Attributes
    ----------
    cells, step
        Stored values and the side of a cell [m].
    gain, offset, beyond
        Of the whitened residual, see `core.cells.kernels`.
    unknown, strict
        What a cell of which nothing is known holds, and whether one of them spoils a place.
    explained
        A beam that ends where the value is within these bounds is explained by the map.
    """

    cells: TiledArray
    step: float
    gain: float
    offset: float
    beyond: float
    unknown: float
    strict: bool
    explained: tuple[float, float]


class CellAlignment(Alignment):
    """A prepared scan; holds on to the map's cells, so it sees what is fused meanwhile.

    Parameters
    ----------
    beams
        The scan in the robot's frame.
    points : shape (n, 4)
        Its points; without normals where the whole gradient counts.
    views
        Coarse to fine.
    code
        Of the interpolation.
    most
        More beams than this count as this many.
    """

    def __init__(self, beams: Beams, points: F64, views: list[CellLevel], code: int, most: float) -> None:
        self.beams = beams
        self.levels = len(views)
        self._views = views
        self._code = code
        self._points = points
        self._n = len(points)
        self._weight = min(1.0, most / self._n) if self._n else 1.0

    def normal_equations(self, pose: F64, level: int, loss: Loss = "none", scale: float = 1.0) -> NormalEquations:
        """Return H, g and cost at `pose` (3,) in one pass."""
        v = self._views[level]
        out = np.empty((4, 3))
        cost, used = kernels.normal_equations(
            *v.cells.arrays(), v.step, self._code, v.unknown, v.strict, v.gain, v.offset, v.beyond,
            self._points, pose, self._weight, CODES[loss], scale, out,
        )  # fmt: skip
        return NormalEquations(out[:3], out[3], cost, used, self._n)

    def costs(self, poses: F64, level: int, loss: Loss = "none", scale: float = 1.0) -> F64:
        """Return the cost at each of `poses` (k, 3): shape (k,)."""
        v = self._views[level]
        return kernels.costs(
            *v.cells.arrays(), v.step, self._code, v.unknown, v.strict, v.gain, v.offset, v.beyond,
            self._points, poses, self._weight, CODES[loss], scale,
        )  # fmt: skip

    def residuals(self, pose: F64, level: int) -> tuple[F64, F64]:
        """Return whitened residuals (n,) and their Jacobian (n, 3)."""
        v = self._views[level]
        residuals = np.empty(self._n)
        rows = np.empty((self._n, 3))
        kernels.jacobian(
            *v.cells.arrays(), v.step, self._code, v.unknown, v.strict, v.gain, v.offset, v.beyond,
            self._points, pose, self._weight, residuals, rows,
        )  # fmt: skip
        return residuals, rows

    def inliers(self, pose: F64, level: int) -> float:
        """Return the share of beams with a return that the map explains, in [0, 1]."""
        if not self._n:
            return 0.0
        v = self._views[level]
        count = kernels.explained(
            *v.cells.arrays(), v.step, v.unknown, v.strict, self._points, pose, v.explained[0], v.explained[1]
        )
        return count / self._n
