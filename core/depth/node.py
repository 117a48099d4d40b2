"""What every depth observer does around its formulas: clean input, motion between frames, coming and going."""

import math
from abc import abstractmethod
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotwork.core import geometry
from knotwork.core.camera import rigid_step
from knotwork.core.contracts import Context, Observer
from knotwork.core.depth.base_path import BasePath
from knotwork.core.depth.config import DepthObserverConfig
from knotwork.core.depth.observer import CHI_MAX, CHI_MIN, convergence_conditions
from knotwork.core.depth.tracks import Tracks, usable
from knotwork.core.messages import F64, CameraTwist, Depths, Features, Odometry

_PATIENCE = 200_000_000  # ns; a frame that waits longer for odometry is dropped


@dataclass(frozen=True, slots=True)
class Estimate:
    """Inverse depths (k,), and variance or uncertainty (k,) if the observer has one; as in `messages.Depths`."""

    chi: F64
    variance: F64 | None = None
    uncertainty: F64 | None = None


class DepthObserver(Observer):
    """Base of the depth observers; a subclass gives `start_rows`, `advance` and `estimate`.

    The motion over a frame is the last `twist` (a command held, as simulators give it), or that of the base between
    the stamps of two frames, from odometry with stamps of its own, carried over to the camera.
    """

    def __init__(self, context: Context, **shapes: tuple[int, ...]) -> None:
        super().__init__(context)
        self.settings: DepthObserverConfig = context.config
        self.tracks = Tracks(self.settings.memory, **shapes)
        self.rotation = np.eye(3)
        self.shift = np.zeros(3)
        self.v = np.zeros(3)
        self.w = np.zeros(3)
        self._stamp: int | None = None
        self._path = BasePath()
        self._waiting: deque[Features] = deque()  # for odometry that is as late

    @abstractmethod
    def start_rows(self, rows: NDArray[np.intp], points: F64, guess: F64) -> None:
        """Fill fresh rows from their first image points (k, 2) and guessed inverse depths (k,)."""

    @abstractmethod
    def advance(self, points: F64, seen: F64, step: float) -> None:
        """Advance all rows by `step` seconds and `rotation`, `shift`; image points (m, 2) where seen (m,)."""

    @abstractmethod
    def estimate(self, rows: NDArray[np.intp]) -> Estimate:
        """Return what the observer knows of these rows."""

    def on_twist(self, message: CameraTwist) -> None:
        """Take the motion since the last frame."""
        if not (np.isfinite(message.v).all() and np.isfinite(message.w).all()):
            self.context.count("bad_twists")
            return
        self.v, self.w = np.array(message.v), np.array(message.w)

    def on_odometry(self, message: Odometry) -> None:
        """Take a pose of the base."""
        if not np.isfinite(message.pose).all():
            self.context.count("bad_odometry")
            return
        self._path.add(message)
        while self._waiting and self._path.covers(self._waiting[0].stamp):
            self._frame(self._waiting.popleft())

    def on_features(self, message: Features) -> None:
        """Advance by one frame and give the depths of what is in view, as soon as odometry has come as far."""
        self._waiting.append(message)
        while self._waiting and self._path.covers(self._waiting[0].stamp):
            self._frame(self._waiting.popleft())
        while self._waiting and message.stamp - self._waiting[0].stamp > _PATIENCE:
            self._waiting.popleft()
            self.context.count("frames_without_motion")

    def _frame(self, message: Features) -> None:
        ids, points = self._clean(message)
        step = 0.0 if self._stamp is None else (message.stamp - self._stamp) * 1e-9
        if step < 0.0:
            self.context.count("late_frames")
            return
        if step > self.settings.gap:
            self.context.count("gaps")
            self.tracks.clear()
        self._motion(message.stamp if self._stamp is None else self._stamp, message.stamp)
        self._stamp = message.stamp
        sigma2, conditions = np.empty(ids.size), np.empty((ids.size, 3), dtype=np.bool_)
        convergence_conditions(points, self.v, self.w, self.settings.excitation, sigma2, conditions)
        rows, seen, fresh = self.tracks.match(ids, step)
        if self.tracks.ids.size and step > 0.0:
            measured = points
            if rows.size != self.tracks.ids.size or fresh.size or not self.tracks.same:
                measured = np.zeros((self.tracks.ids.size, 2))
                measured[rows] = points
            self.advance(measured, seen, step)
        if fresh.size:
            new = np.isin(rows, fresh)
            self.start_rows(rows[new], points[new], self._guesses(ids[new]))
        known = self.estimate(rows)
        self.context.emit(
            "depths",
            Depths(
                stamp=message.stamp,
                ids=ids,
                points=points,
                sigma2=sigma2,
                conditions=conditions,
                chi=known.chi,
                variance=known.variance,
                uncertainty=known.uncertainty,
            ),
        )

    def _clean(self, message: Features) -> tuple[NDArray[np.int64], F64]:
        ids = np.asarray(message.ids, dtype=np.int64).reshape(-1)
        points = np.asarray(message.points, dtype=np.float64).reshape(-1, 2)
        if len(ids) == len(points) and np.array_equal(ids, self.tracks.ids) and math.isfinite(points.sum()):
            return ids, points.copy()  # the usual frame; kernels are compiled for writeable arrays
        if len(ids) != len(points):
            self.context.count("malformed_frames")
            return np.empty(0, dtype=np.int64), np.empty((0, 2))
        good = usable(ids, points)
        if self.settings.ignore:
            good &= ~np.isin(ids, self.settings.ignore)
        elif good.all():
            return ids, points.copy()
        self.context.count("skipped_features", int((~good).sum()))
        return ids[good], points[good]

    def _motion(self, before: int, stamp: int) -> None:
        step = (stamp - before) * 1e-9
        start, end = self._path.at(before), self._path.at(stamp)
        if start is not None and end is not None and step > 0.0:
            forward, left, turn = geometry.log(geometry.relative(start, end))
            offset = self.settings.offset
            self.v = np.array((-(left + offset * turn), 0.0, forward)) / step
            self.w = np.array((0.0, -turn, 0.0)) / step
        rigid_step(self.v, self.w, step, self.rotation, self.shift)

    def _guesses(self, ids: NDArray[np.int64]) -> F64:
        guess = self.settings.guess
        numbers = [guess.get(i, 1.0) for i in ids.tolist()] if isinstance(guess, dict) else guess
        out: F64 = np.clip(np.full(ids.size, numbers), CHI_MIN, CHI_MAX)
        return out
