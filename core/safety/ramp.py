"""Rim speeds that follow a goal within acceleration limits, on the curve the goal asks for."""

from knotwork.core.world.kinematics import limited, wheel_speeds


def wheel_goal(
    v: float, w: float, separation: float, fastest: float, speed: float | None, yaw_rate: float | None
) -> tuple[float, float]:
    """Return rim speeds [m/s] of a twist, slowed by one factor until every limit holds: the curvature is kept.

    Parameters
    ----------
    v, w
        Forward speed [m/s] and yaw rate [rad/s]; finite.
    separation
        Distance between the wheels [m].
    fastest
        Limit of a rim [m/s].
    speed, yaw_rate
        Limits of the body [m/s, rad/s]; None: none.
    """
    factor = 1.0
    if speed is not None and abs(v) > speed:
        factor = speed / abs(v)
    if yaw_rate is not None and abs(w) > yaw_rate:
        factor = min(factor, yaw_rate / abs(w))
    return limited(*wheel_speeds(v * factor, w * factor, separation), fastest)


class WheelRamp:
    """Both rims move towards their goal in proportion, so that a curve stays one curve while its speed changes.

    Attributes
    ----------
    left, right
        Present rim speeds as commanded [m/s].
    """

    def __init__(self, acceleration: float, deceleration: float) -> None:
        self.left = self.right = 0.0
        self._up = acceleration
        self._down = deceleration

    @property
    def standing(self) -> bool:
        """Whether both rims are told to stand."""
        return self.left == 0.0 == self.right

    def reset(self) -> None:
        """Say that the wheels stand."""
        self.left = self.right = 0.0

    def step(self, left: float, right: float, period: float) -> tuple[float, float]:
        """Return the rim speeds after `period` [s] on the way to the goal [m/s]."""
        share = min(1.0, self._share(self.left, left, period), self._share(self.right, right, period))
        if share >= 1.0:
            self.left, self.right = left, right
        else:
            self.left += share * (left - self.left)
            self.right += share * (right - self.right)
        return self.left, self.right

    def _share(self, speed: float, goal: float, period: float) -> float:
        """Part of the way to the goal that this rim can go."""
        change = abs(goal - speed)
        slows = abs(goal) < abs(speed) and goal * speed >= 0.0
        limit = (self._down if slows else min(self._up, self._down)) * period
        return 1.0 if change <= limit else limit / change
