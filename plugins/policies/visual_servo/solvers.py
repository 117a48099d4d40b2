"""Solvers of the servo program: Clarabel's cones, the compiled method, any QP solver with tangent cuts."""

import warnings
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol

import numpy as np

from knotwork.core.depth.servo import solve_cone
from knotwork.core.errors import InputError
from knotwork.core.messages import F64

_CUTS = 40  # rounds of tangent cuts; 2 to 6 are usual
_TIGHT = 1e-6


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
        """Return H and g in units of the radii."""
        radii = np.repeat((self.v_max, self.w_max), 3)
        return radii[:, None] * self.hessian * radii, radii * self.gradient


class Solver(Protocol):
    """Gives u (6,) in units of the radii, or None when there is no answer."""

    def __call__(self, program: Program) -> F64 | None:
        """Solve one program."""


def solver(name: str, node: str) -> Solver:
    """Return a solver by name.

    Raises
    ------
    InputError
        It is not known or not installed.
    """
    if name == "compiled":
        return compiled
    hint = "pip install knotwork[policies], or write solver: compiled"
    try:
        if name == "clarabel":
            return Clarabel()
        return TangentCuts(name)
    except ImportError as error:
        raise InputError(f"solver {name!r}: {error}", where=f"node {node}", hint=hint) from error
    except ValueError as error:
        raise InputError(str(error), where=f"node {node}", hint=hint) from error


def compiled(program: Program) -> F64 | None:
    """Solve by the built-in interior-point method."""
    u = np.empty(6)
    p = program
    solved = solve_cone(p.hessian, p.gradient, p.rows, p.bounds, p.v_z_bound, p.direction, p.least, p.v_max, p.w_max, u)
    return u / np.repeat((p.v_max, p.w_max), 3) if solved else None


class Clarabel:
    """Second-order cones, exact."""

    def __init__(self) -> None:
        self._clarabel: Any = import_module("clarabel")
        self._sparse: Any = import_module("scipy.sparse")
        self._settings = self._clarabel.DefaultSettings()
        self._settings.verbose = False

    def __call__(self, program: Program) -> F64 | None:
        """Solve one program."""
        module = self._clarabel
        hessian, gradient = program.scaled()
        # Two or fewer points leave directions that cost nothing; of those the still one is wanted.
        hessian = hessian + 1e-11 * max(float(np.abs(hessian).max()), 1e-300) * np.eye(6)
        planes, limits = program.planes()
        ball = np.zeros((8, 6))
        ball[1:4, :3] = ball[5:, 3:] = -np.eye(3)
        right = np.concatenate((limits, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)))
        cones = [module.NonnegativeConeT(len(limits))] if len(limits) else []
        cones += [module.SecondOrderConeT(4), module.SecondOrderConeT(4)]
        sparse = self._sparse.csc_matrix
        solution = module.DefaultSolver(
            sparse(np.triu(hessian)), gradient, sparse(np.vstack((planes, ball))), right, cones, self._settings
        ).solve()
        return np.array(solution.x) if str(solution.status) in ("Solved", "AlmostSolved") else None


class TangentCuts:
    """A box, then a tangent plane wherever the answer leaves a ball, until the balls hold to 1e-6."""

    def __init__(self, name: str) -> None:
        self._module: Any = import_module("qpsolvers")
        if name not in self._module.available_solvers:
            found = ", ".join(self._module.available_solvers) or "none"
            raise ValueError(f"qpsolvers has no solver {name!r} here; it has: {found}")
        self._name = name
        takes_sparse = name in self._module.sparse_solvers
        self._matrix: Any = import_module("scipy.sparse").csc_matrix if takes_sparse else np.asarray
        # OSQP does not always reach the fine tolerance on these badly conditioned programs.
        self._options: list[dict[str, float]] = [{}]
        if name == "osqp":
            self._options = [{"eps_abs": eps, "eps_rel": eps, "max_iter": 10000} for eps in (1e-6, 1e-4)]

    def __call__(self, program: Program) -> F64 | None:
        """Solve one program."""
        hessian, gradient = program.scaled()
        size = max(float(np.abs(hessian).max()), float(np.abs(gradient).max()), 1e-300)
        hessian = hessian / size + 1e-9 * np.eye(6)
        planes, limits = program.planes()
        ones = np.ones(6)
        for _ in range(_CUTS):
            part = self._module.Problem(
                self._matrix(hessian),
                gradient / size,
                self._matrix(planes) if len(limits) else None,
                limits if len(limits) else None,
                lb=-ones,
                ub=ones,
            )
            u = self._solve(part)
            if u is None:
                return None
            cuts = []
            for first in (0, 3):
                tangent = np.zeros(6)
                tangent[first : first + 3] = u[first : first + 3]
                length = float(np.linalg.norm(tangent))
                if length > 1.0 + _TIGHT:
                    cuts.append(tangent / length)
            if not cuts:
                return u
            planes = np.vstack((planes, *cuts))
            limits = np.concatenate((limits, np.ones(len(cuts))))
        return None

    def _solve(self, part: Any) -> F64 | None:
        for options in self._options:
            with warnings.catch_warnings():  # "solved inaccurate": what matters is checked here
                warnings.simplefilter("ignore")
                solution = self._module.solve_problem(part, solver=self._name, **options)
            if solution.found and solution.x is not None and np.isfinite(solution.x).all():
                return np.asarray(solution.x, dtype=np.float64)
        return None
