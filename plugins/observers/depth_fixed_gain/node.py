"""The observer (8.12) as a node."""

import numpy as np
from numpy.typing import NDArray

from knotwork.core.contracts import Context
from knotwork.core.depth.node import DepthObserver, Estimate
from knotwork.core.depth.observer import CRITICAL, fixed_gain_step, uncertainty_step
from knotwork.core.messages import F64
from knotwork.plugins.observers.depth_fixed_gain import Config


class FixedGain(DepthObserver):
    """Trapezoid steps of (8.12), stable at any gain and frame rate."""

    def __init__(self, context: Context) -> None:
        config: Config = context.config
        super().__init__(context, s_hat=(2,), chi=(), before=(2,), window=(config.window,), count=(), uncertainty=())
        self.config = config
        self._k_chi = CRITICAL if config.k_chi == "critical" else float(config.k_chi)

    def warm(self) -> None:
        """Compile the kernels."""
        one, none = np.zeros((1, 2)), np.zeros(1)
        self._step(one, np.ones(1), one.copy(), one.copy(), 0.05, none)
        uncertainty_step(np.zeros((1, self.config.window)), np.zeros(1), one, one, none, np.zeros(1))

    def start_rows(self, rows: NDArray[np.intp], points: F64, guess: F64) -> None:
        """Begin at the measured position with the guessed depth."""
        tracks = self.tracks
        tracks["s_hat"][rows] = tracks["before"][rows] = points
        tracks["chi"][rows] = guess
        tracks["window"][rows] = 0.0
        tracks["count"][rows] = 0.0
        tracks["uncertainty"][rows] = np.inf

    def advance(self, points: F64, seen: F64, step: float) -> None:
        """One frame of (8.12) and (9.41)."""
        tracks = self.tracks
        self._step(tracks["s_hat"], tracks["chi"], tracks["before"], points, step, seen)
        uncertainty_step(tracks["window"], tracks["count"], points, tracks["s_hat"], seen, tracks["uncertainty"])

    def estimate(self, rows: NDArray[np.intp]) -> Estimate:
        """Return inverse depths and their uncertainty."""
        return Estimate(self.tracks["chi"][rows], uncertainty=self.tracks["uncertainty"][rows])

    def _step(self, s_hat: F64, chi: F64, before: F64, points: F64, step: float, seen: F64) -> None:
        config = self.config
        fixed_gain_step(
            s_hat, chi, before, points, seen, self.v, self.w, self.rotation, self.shift,
            step, config.k_s, self._k_chi, config.floor,
        )  # fmt: skip
