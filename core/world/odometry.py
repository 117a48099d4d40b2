"""Dead reckoning from wheel angles, with the heading of the wheels or of a gyro."""

from math import cos, sin

import numpy as np

from knotwork.core.geometry import IDENTITY
from knotwork.core.messages import F64, Odometry
from knotwork.core.world.kinematics import arc, body_twist
from knotwork.core.world.parameters import BaseParameters, gyro_sigma

# A scale error or a bias is the same all through a run; as white noise of a filter it is counted as
# independent from one stretch of this length to the next.
_SCALE_LENGTH = 1.0  # m
_BIAS_TIME = 1.0  # s


class DeadReckoning:
    """Integrates exact arcs from wheel angles; the covariance is that of the errors in `parameters`.

    Parameters
    ----------
    parameters
        Wheel geometry and the size of the errors.
    gyro
        Take the change of heading from the gyro instead of the wheels.
    covariance
        Say how uncertain each step is.
    """

    def __init__(self, parameters: BaseParameters, gyro: bool, covariance: bool) -> None:
        self.parameters = parameters
        self.gyro = gyro
        self.covariance = covariance
        self.pose = IDENTITY
        self.wheel_rates = (0.0, 0.0)  # over the last step [rad/s]
        self._left = self._right = 0.0

    def update(self, stamp: int, left: float, right: float, yaw_rate: float, period: float) -> Odometry:
        """Add a step.

        Parameters
        ----------
        stamp
            Time of the new wheel angles [ns].
        left, right
            Wheel angles since the start [rad].
        yaw_rate
            Mean over the step, from the gyro [rad/s].
        period
            Time since the last step [s].
        """
        p = self.parameters
        turned = (left - self._left, right - self._right)
        self.wheel_rates = (turned[0] / period, turned[1] / period)
        rims = (turned[0] * p.wheel_radius, turned[1] * p.wheel_radius)
        self._left, self._right = left, right
        length, turn = body_twist(*rims, p.wheel_separation)
        if self.gyro:
            turn = yaw_rate * period
        self.pose = arc(self.pose, length, turn)
        return Odometry(
            stamp=stamp,
            pose=np.array(self.pose),
            twist=np.array((length / period, 0.0, turn / period)),
            covariance=self._covariance(rims, length, turn, period) if self.covariance else None,
        )

    def start(self, stamp: int) -> Odometry:
        """Return the first message: at the origin, standing."""
        zero = np.zeros((3, 3)) if self.covariance else None
        return Odometry(stamp=stamp, pose=np.zeros(3), twist=np.zeros(3), covariance=zero)

    def _covariance(self, rims: tuple[float, float], length: float, turn: float, period: float) -> F64:
        """Covariance of the step (3, 3) from those of distance and turn, in the frame before the step."""
        p = self.parameters
        tick = 2.0 * np.pi * p.wheel_radius / p.ticks if p.ticks else 0.0
        per_metre = p.slip**2 + p.slip_scale**2 * _SCALE_LENGTH
        # Quantisation errors of successive steps cancel; as white noise a twelfth of a tick squared is
        # shared by the steps in which the wheel passes one tick.
        left, right = (per_metre * abs(d) + tick * min(abs(d), tick) / 12.0 for d in rims)
        along = 0.25 * (left + right)
        if self.gyro:
            both = 0.0
            angle = (gyro_sigma(p, period) * period) ** 2 + p.gyro_bias**2 * period * _BIAS_TIME
        else:
            both = 0.5 * (right - left) / p.wheel_separation
            angle = (left + right) / p.wheel_separation**2
        # The step ends at length * (cos, sin)(turn / 2), up to second order in the turn: its derivatives
        # with respect to length and turn are (c, s) and (-q, r).
        c, s = cos(0.5 * turn), sin(0.5 * turn)
        q, r = 0.5 * length * s, 0.5 * length * c
        xx = c * c * along - 2.0 * c * q * both + q * q * angle
        xy = c * s * along + (c * r - s * q) * both - q * r * angle
        yy = s * s * along + 2.0 * s * r * both + r * r * angle
        xa, ya = c * both - q * angle, s * both + r * angle
        return np.array(((xx, xy, xa), (xy, yy, ya), (xa, ya, angle)))
