"""Solvers of the servo program: Clarabel's cones, the compiled method; `tangent_cuts` has those of qpsolvers."""

from importlib import import_module
from typing import Any, Protocol

import numpy as np

from knotwork.core.depth.servo import solve_cone
from knotwork.core.errors import InputError
from knotwork.core.messages import F64
from knotwork.plugins.policies.visual_servo.program import Program
from knotwork.plugins.policies.visual_servo.tangent_cuts import TangentCuts

_TOLERANCE = 1e-10  # Clarabel's own, 1e-8, leaves up to 0.02 of a radius where the cost is nearly flat


class Solver(Protocol):
    """Gives u (6,) in units of the radii, or None when there is no answer."""

    def __call__(self, program: Program) -> F64 | None:
        """Solve one program."""


def solver(name: str) -> Solver:
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
        raise InputError(f"solver {name!r}: {error}", hint=hint) from error
    except ValueError as error:
        raise InputError(str(error), hint=hint) from error


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
        for name in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
            setattr(self._settings, name, _TOLERANCE)

    def __call__(self, program: Program) -> F64 | None:
        """Solve one program."""
        module = self._clarabel
        hessian, gradient = program.scaled()
        if not (np.isfinite(hessian).all() and np.isfinite(gradient).all()):
            return None
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
