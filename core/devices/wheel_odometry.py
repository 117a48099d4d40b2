"""From encoder counts that wrap, jump and restart to odometry."""

from dataclasses import replace

import numpy as np

from knotwork.core.messages import Odometry, Wheels
from knotwork.core.world.odometry import DeadReckoning
from knotwork.core.world.parameters import BaseParameters

_TURN = 2.0 * np.pi
_PAUSE = 1.0  # s for which a device may show old counts
_SLACK = 200  # ticks that two readings may differ beyond what the wheels can roll


class WheelOdometry:
    """Dead reckoning on 32-bit encoder counts.

    A change that no wheel can roll is a damaged reading if the next one contradicts it. If the next one
    confirms it, the encoders have restarted, which they do within a turn of zero, and odometry goes on from
    where it was, marked as a discontinuity; or the device has shown old counts for a moment.

    Parameters
    ----------
    radius, separation
        Of the wheels, between the wheels [m].
    tick
        Angle of a wheel from a count to the next [rad].
    fastest
        Limit of a rim [m/s].
    gyro
        The heading comes with `update`.
    gyro_bias
        Sigma of the gyro's bias [rad/s], for the covariance.
    covariance
        Odometry says how uncertain it is.

    Attributes
    ----------
    rejected, restarts
        Damaged readings; restarts of the encoders.
    moved
        When the counts changed last [ns], 0 for never.
    """

    def __init__(
        self,
        radius: float,
        separation: float,
        tick: float,
        fastest: float,
        *,
        gyro: bool,
        covariance: bool,
        gyro_bias: float = 5e-4,
    ) -> None:
        parameters = BaseParameters(
            wheel_radius=radius,
            wheel_separation=separation,
            wheel_speed_max=fastest,
            ticks=round(_TURN / tick),
            gyro_bias=gyro_bias,
        )
        self.rejected = self.restarts = 0
        self.moved = 0
        self._reckoning = DeadReckoning(parameters, gyro, covariance)
        self._angle_of_tick = tick
        self._per_second = 2.0 * fastest / radius / self._angle_of_tick
        self._angles = [0.0, 0.0]
        self._last: tuple[int, int] | None = None
        self._suspect: tuple[int, int] | None = None
        self._stamp = self._within = 0

    @property
    def read(self) -> int:
        """When the counts were read last [ns], 0 for never."""
        return self._stamp

    def restart(self) -> None:
        """Take the next reading as a new beginning: the odometry goes on, marked."""
        self._last = None

    def update(
        self,
        stamp: int,
        ticks: tuple[int, int],
        velocity: tuple[float, float],
        turn: float | None,
        within: int = 0,
    ) -> tuple[Odometry, Wheels] | None:
        """Add a reading; None if it is not to be believed.

        Parameters
        ----------
        stamp
            Time of the reading [ns].
        ticks
            Counts, left and right, as signed 32-bit numbers.
        velocity
            Of the wheels [rad/s].
        turn
            Change of heading since the last reading that was believed, from a gyro [rad]; None: the wheels say.
        within
            The reading was taken at `stamp` give or take this [ns]: a host that paused does not know better.
        """
        if self._last is None:
            first = self._stamp == 0
            self._last, self._stamp, self._suspect, self._within = ticks, stamp, None, within
            odometry = self._reckoning.start(stamp)
            odometry = replace(odometry, pose=np.array(self._reckoning.pose), discontinuity=not first)
            return odometry, self._wheels(stamp, velocity, not first)
        period = (stamp - self._stamp) * 1e-9
        if period <= 0.0:
            return None
        change = _difference(ticks, self._last)
        most = self._per_second * (period + (within + self._within) * 1e-9) + _SLACK
        if max(abs(change[0]), abs(change[1])) > most:
            again = _difference(ticks, self._suspect) if self._suspect is not None else None
            self._suspect = ticks
            if again is None or max(abs(again[0]), abs(again[1])) > most:
                self.rejected += 1
                return None
            if self._restarted(change, ticks, most):
                self.restarts += 1
                self.restart()
                return self.update(stamp, ticks, velocity, turn, within)
        self._suspect = None
        self._last, self._stamp, self._within = ticks, stamp, within
        if change != (0, 0) or not self.moved:
            self.moved = stamp
        for side in (0, 1):
            self._angles[side] += change[side] * self._angle_of_tick
        odometry = self._reckoning.update(
            stamp, self._angles[0], self._angles[1], 0.0 if turn is None else turn / period, period
        )
        return odometry, self._wheels(stamp, velocity, False)

    def _restarted(self, change: tuple[int, int], ticks: tuple[int, int], most: float) -> bool:
        """Tell whether a change that two readings agree on is a restart, not a device that paused for a moment."""
        if max(abs(change[0]), abs(change[1])) > most + self._per_second * _PAUSE:
            return True
        turn = _TURN / self._angle_of_tick
        return any(abs(c) > most and -turn <= t < 2.0 * turn for c, t in zip(change, ticks, strict=True))

    def _wheels(self, stamp: int, velocity: tuple[float, float], discontinuity: bool) -> Wheels:
        return Wheels(
            stamp=stamp,
            angle=np.array(self._angles),
            velocity=np.array(velocity),
            discontinuity=discontinuity,
        )


def _difference(a: tuple[int, int], b: tuple[int, int]) -> tuple[int, int]:
    """Change of 32-bit counts that may have wrapped."""
    return _wrapped(a[0] - b[0]), _wrapped(a[1] - b[1])


def _wrapped(change: int) -> int:
    return (change + 0x8000_0000) % 0x1_0000_0000 - 0x8000_0000
