"""The controller's program as plain arrays: what every solver is given."""

from dataclasses import dataclass

import numpy as np

from knotwork.core.messages import F64

PROXIMAL = 1e-11  # of the largest entry of H and g


@dataclass(frozen=True, slots=True)
class Program:
    """Minimise u^T H u / 2 + g^T u; the constraints as of `core.depth.servo.solve_cone`."""

    hessian: F64
    gradient: F64
    rows: F64
    bounds: F64
    v_z_bound: float
    direction: F64
    least: float
    v_max: float
    w_max: float

    def planes(self) -> tuple[F64, F64]:
        """Return the half-spaces A u <= b in units of the radii, u = (v / v_max, w / w_max)."""
        rows, limits = [], []
        for (x, y), bound in zip(self.rows.tolist(), self.bounds.tolist(), strict=True):
            rows.append((0.0, 0.0, 0.0, y, -x, 0.0))
            limits.append(bound / self.w_max)
        if self.v_z_bound < self.v_max:
            rows.append((0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
            limits.append(self.v_z_bound / self.v_max)
        if self.least >= 0.0:
            rows.append((-self.direction[0], -self.direction[1], 0.0, 0.0, 0.0, 0.0))
            limits.append(-self.least)
        return np.array(rows).reshape(-1, 6), np.array(limits)

    def scaled(self) -> tuple[F64, F64]:
        """Return H (6, 6) and g (6,) in units of the radii, their largest entry 1 and H positive definite.

        One or two points leave directions that cost nothing; `PROXIMAL` makes the still one of them the best.
        """
        radii = np.repeat((self.v_max, self.w_max), 3)
        hessian, gradient = radii[:, None] * self.hessian * radii, radii * self.gradient
        size = max(float(np.abs(hessian).max()), float(np.abs(gradient).max()), 1e-300)
        return hessian / size + PROXIMAL * np.eye(6), gradient / size
