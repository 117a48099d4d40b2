"""When the next thing may happen: at once, or as the wall clock allows."""

from knotwork.core import clock

_LONGEST_WAIT = 0.2  # s; a stop is noticed this late at most


class Pace:
    """Ties the run's time to the wall clock at a rate; a rate of None runs free."""

    def __init__(self, rate: float | None) -> None:
        self.begun = False
        self._rate = rate
        self._time = 0
        self._wall = 0

    def begin(self, time: int) -> None:
        """Tie the run's `time` [ns] to this moment."""
        self.begun = True
        self._time = time
        self._wall = clock.monotonic()

    def now(self, event_time: int | None) -> int:
        """Return how far the run's time may go [ns]: to the event when running free."""
        if self._rate is None or not self.begun:
            return event_time if event_time is not None else self._time
        return self._time + round((clock.monotonic() - self._wall) * self._rate)

    def wait(self, event_time: int | None, due: int | None) -> float:
        """Return how long [s] nothing may happen; 0 when the next event or timer is due."""
        if self._rate is None or not self.begun:
            return 0.0 if event_time is not None else _LONGEST_WAIT
        times = [t for t in (event_time, due) if t is not None]
        if not times:
            return _LONGEST_WAIT
        ahead = (min(times) - self.now(None)) / self._rate / 1e9
        return min(max(ahead, 0.0), _LONGEST_WAIT)
