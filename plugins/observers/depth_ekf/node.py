"""The filter in (x, y, chi) as a node."""

import numpy as np
from numpy.typing import NDArray

from knotwork.core.contracts import Context
from knotwork.core.depth.ekf import ekf_start, ekf_step
from knotwork.core.depth.node import DepthObserver, Estimate
from knotwork.core.messages import F64
from knotwork.plugins.observers.depth_ekf import Config


class DepthEkf(DepthObserver):
    """One small filter for each feature; the prediction is the exact rigid motion."""

    def __init__(self, context: Context) -> None:
        super().__init__(context, state=(3,), covariance=(3, 3))
        self.config: Config = context.config

    def warm(self) -> None:
        """Compile the kernels."""
        state, covariance = np.ones((1, 3)), np.eye(3)[None]
        ekf_start(state, covariance, 0, 0.0, 0.0, 1.0, 1.0, 1.0)
        self._step(state, covariance, np.zeros((1, 2)), np.ones(1), 0.05)

    def start_rows(self, rows: NDArray[np.intp], points: F64, guess: F64) -> None:
        """Begin at the measured position with the guessed depth."""
        state, covariance = self.tracks["state"], self.tracks["covariance"]
        for row, (x, y), chi in zip(rows.tolist(), points.tolist(), guess.tolist(), strict=True):
            ekf_start(state, covariance, row, x, y, chi, self.config.noise, self.config.guess_sd)

    def advance(self, points: F64, seen: F64, step: float) -> None:
        """Predict and correct."""
        self._step(self.tracks["state"], self.tracks["covariance"], points, seen, step)

    def estimate(self, rows: NDArray[np.intp]) -> Estimate:
        """Return inverse depths and their variances."""
        return Estimate(self.tracks["state"][rows, 2], variance=self.tracks["covariance"][rows, 2, 2])

    def _step(self, state: F64, covariance: F64, points: F64, seen: F64, step: float) -> None:
        c = self.config
        ekf_step(
            state, covariance, points, seen, self.rotation, self.shift,
            step, c.noise, c.position_growth, c.depth_growth,
        )  # fmt: skip
