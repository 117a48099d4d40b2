"""Two hosts have two clocks: how far the other's is ahead, and how long the way there and back is.

As NTP does (RFC 5905, section 8): a ping leaves at t0 by this clock, is answered at t1 by the other's, and
is back at t3; offset = t1 - (t0 + t3) / 2, wrong by at most half the round trip t3 - t0. The quickest of the
last samples is the one to believe.
"""

from collections import deque
from statistics import median

_SAMPLES = 16


class ClockEstimate:
    """Offset and round trip from pings."""

    def __init__(self) -> None:
        self._samples: deque[tuple[int, int]] = deque(maxlen=_SAMPLES)  # round trip, offset [ns]

    def __bool__(self) -> bool:
        return bool(self._samples)

    def forget(self) -> None:
        """Begin anew: another clock is at the other end."""
        self._samples.clear()

    def add(self, left: int, answered: int, back: int) -> None:
        """Take a ping: when it left and came back by this clock, when it was answered by the other's [ns]."""
        if back >= left:
            self._samples.append((back - left, answered - (left + back) // 2))

    @property
    def offset(self) -> int:
        """The other's clock minus this one [ns]."""
        return min(self._samples)[1]

    @property
    def round_trip(self) -> int:
        """Median of the last round trips [ns]."""
        return round(median(trip for trip, _ in self._samples))

    def age(self, given: int, arrived: int) -> int:
        """Return how old a message was when it arrived [ns], never less than half the quickest round trip.

        Parameters
        ----------
        given
            By the other's clock.
        arrived
            By this one.
        """
        quickest, offset = min(self._samples)
        return max(quickest // 2, arrived - (given - offset))
