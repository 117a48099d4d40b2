"""A gyro whose bias is learned whenever the wheels stand."""

from math import sqrt

_SETTLE = 0.3  # s; the body sways after it has stopped
_WINDOW = 1.0  # s of standing that make one measurement
_TURNED = 0.02  # rad/s; faster than any bias: somebody has lifted the robot and turns it


class StandingGyro:
    """Takes its bias off a gyro's changes of heading.

    A robot whose wheels stand does not turn: what its gyro then says is bias, and the heading stays. The bias
    is a Kalman filter of one state, a random walk; a second of standing is a measurement of variance
    noise^2 / 1 s.

    Parameters
    ----------
    noise
        Density of the gyro's white noise [rad/s/sqrt(Hz)].
    sigma
        Of the bias before anything is known [rad/s].
    wander
        Random walk of the bias [rad/s/sqrt(s)].

    Attributes
    ----------
    bias
        Estimate [rad/s].
    """

    def __init__(self, noise: float, sigma: float, wander: float = 5e-6) -> None:
        self.bias = 0.0
        self._noise = noise
        self._wander = wander
        self._variance = sigma * sigma
        self._stood = 0.0  # s
        self._turn = self._span = 0.0  # of the measurement under way

    @property
    def sigma(self) -> float:
        """Standard deviation of the estimate [rad/s]."""
        return sqrt(self._variance)

    def turn(self, turn: float, period: float, stands: bool) -> float:
        """Return a change of heading without the bias [rad].

        Parameters
        ----------
        turn
            What the gyro says [rad].
        period
            In which time [s].
        stands
            The wheels did not turn in it.
        """
        self._variance += self._wander**2 * period
        corrected = turn - self.bias * period
        if not stands or abs(corrected) > _TURNED * period + 5.0 * self._noise * sqrt(period):
            self._stood = self._turn = self._span = 0.0
            return corrected
        self._stood += period
        if self._stood < _SETTLE:
            return corrected
        self._turn += turn
        self._span += period
        if self._span >= _WINDOW:
            self._measure(self._turn / self._span, self._noise**2 / self._span)
            self._turn = self._span = 0.0
        return 0.0

    def _measure(self, rate: float, variance: float) -> None:
        gain = self._variance / (self._variance + variance)
        self.bias += gain * (rate - self.bias)
        self._variance *= 1.0 - gain
