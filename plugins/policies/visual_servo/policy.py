"""The controller of section 9.2 as a node."""

import math

import numpy as np

from knotwork.core.contracts import Context, Policy
from knotwork.core.depth.observer import certainty_of_energy, certainty_of_variance
from knotwork.core.depth.servo import servo_problem
from knotwork.core.errors import InputError
from knotwork.core.messages import F64, CameraTwist, Depths, ServoState
from knotwork.plugins.policies.visual_servo import Config
from knotwork.plugins.policies.visual_servo.program import Program
from knotwork.plugins.policies.visual_servo.solvers import solver


class VisualServo(Policy):
    """One command for each frame of depths; a safe stop whenever there is no good answer."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        config: Config = context.config
        self.config = config
        for name in ("uncertainty", "deviation"):
            low, high = getattr(config, name)
            if not 0.0 <= low < high:
                raise InputError(f"{name}: expected 0 <= certain < uncertain, found {[low, high]}", where=context.name)
        if not all(math.isfinite(value) for point in config.goal.values() for value in point):
            raise InputError("goal: coordinates must be finite", where=context.name)
        self.solve = solver(config.solver)
        self._constrained = config.mode in ("active", "active+")
        self._beta = config.excitation if config.mode == "active+" else -1.0
        self._released: dict[int, float] = {}
        self._lateral = np.zeros(2)
        self._last: int | None = None
        self._warned = False

    def open(self) -> None:
        """Watch for silence."""
        self.context.every(self.config.timeout, self._watch)

    def warm(self) -> None:
        """Compile the kernels and load the solver."""
        s = np.array(((0.1, 0.0), (0.0, 0.1)))
        one = np.ones(2)
        self.solve(self._program(s, one, s + 0.1, one, one.copy())[1])
        certainty_of_energy(one, 0.1, 0.2, one.copy())
        certainty_of_variance(one, one, 0.1, 0.2, one.copy())

    def on_depths(self, message: Depths) -> None:
        """Answer estimated depths."""
        if self.config.mode != "ideal":
            self._command(message)

    def on_truth(self, message: Depths) -> None:
        """Answer true depths."""
        if self.config.mode == "ideal":
            self._command(message)

    def _command(self, message: Depths) -> None:
        self._last = message.stamp
        goal = self.config.goal
        good = np.isfinite(message.chi) & (message.chi > 0.0)
        if not good.all():
            self.context.count("bad_depths", int((~good).sum()))
        chosen = [i for i, name in enumerate(message.ids.tolist()) if name in goal and good[i]]
        if not chosen:
            self.context.count("no_features")
            self._stop(message.stamp)
            return
        ids = message.ids[chosen]
        names = ids.tolist()
        s, chi = np.ascontiguousarray(message.points[chosen]), message.chi[chosen]
        target = np.array([goal[name] for name in names])
        rho = self._certainty(message, np.array(chosen), chi)
        released = np.array([self._released.get(name, 0.0) for name in names])
        error, program = self._program(s, chi, target, rho, released)
        self._released.update(zip(names, released.tolist(), strict=True))
        u = self.solve(program)
        solved = u is not None
        if u is None:
            self.context.count("failed_solves")
            if not self._warned:
                self._warned = True
                self.context.report("warning", "the controller's program has no answer: the camera stops")
            u = np.zeros(6)
        v, w = _inside(u[:3], self.config.v_max), _inside(u[3:], self.config.w_max)
        self._lateral = v[:2].copy()
        self.context.emit("twist", CameraTwist(stamp=self.context.now(), v=v, w=w))
        phase = 1 if rho.max() == 0.0 else (3 if rho.min() == 1.0 else 2)
        state = ServoState(
            stamp=message.stamp, phase=phase, error=error, ids=ids, certainty=rho,
            exciting=program.least >= 0.0, solved=solved,
        )  # fmt: skip
        self.context.emit("state", state)

    def _program(self, s: F64, chi: F64, goal: F64, rho: F64, released: F64) -> tuple[float, Program]:
        config = self.config
        hessian, gradient, bounds, direction = np.empty((6, 6)), np.empty(6), np.empty(len(s)), np.empty(2)
        error, v_z_bound, least = servo_problem(
            s, chi, goal, rho, released, self._lateral, config.gain, config.v_max, config.w_max, self._beta,
            hessian, gradient, bounds, direction,
        )  # fmt: skip
        rows = s if self._constrained else s[:0]
        return error, Program(
            hessian, gradient, rows, bounds[: len(rows)], v_z_bound if self._constrained else math.inf,
            direction, least, config.v_max, config.w_max,
        )  # fmt: skip

    def _certainty(self, message: Depths, chosen: "np.ndarray[tuple[int], np.dtype[np.intp]]", chi: F64) -> F64:
        rho = np.zeros(len(chosen))
        if self.config.mode == "ideal":
            rho[:] = 1.0
        elif message.uncertainty is not None:
            certainty_of_energy(message.uncertainty[chosen], *self.config.uncertainty, rho)
        elif message.variance is not None:
            certainty_of_variance(message.variance[chosen], chi, *self.config.deviation, rho)
        return rho

    def _watch(self, time: int) -> None:
        if self._last is not None and (time - self._last) * 1e-9 > self.config.timeout:
            self.context.count("silences")
            self._stop(time)

    def _stop(self, stamp: int) -> None:
        self.context.emit("twist", CameraTwist(stamp=stamp, v=np.zeros(3), w=np.zeros(3)))


def _inside(u: F64, radius: float) -> F64:
    """Return u times the radius, its norm never above the radius, also after rounding."""
    out = u * radius
    length = float(np.linalg.norm(out))
    limit = radius * (1.0 - 4e-16)
    return out * (limit / length) if length > limit else out
