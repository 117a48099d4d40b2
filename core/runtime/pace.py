"""When the next thing may happen: at once, or as the wall clock and whoever watches allow."""

from knotwork.core import clock
from knotwork.core.errors import InputError

_LONGEST_WAIT = 0.2  # s; a stop is noticed this late at most
_LOOK = 0.05  # s between looks at whether a pause is over


class Pace:
    """Ties the run's time to the wall clock at a rate; a rate of None runs free.

    `pause`, `resume`, `step` and `rate` may be used from any thread (`contracts.Playback`); everything else
    is the dispatcher's. None of it changes what happens or in which order.
    """

    def __init__(self, rate: float | None) -> None:
        self.begun = False
        self._rate = rate
        self._time = 0
        self._wall = 0
        self._paused = False
        self._step: str | None = None  # let events pass until one of this type; "": of any
        self._untied = False
        self.touched = False  # somebody has used it since the last event

    # What a viewer does.

    @property
    def paused(self) -> bool:
        """Whether the run stands still."""
        return self._paused

    @property
    def rate(self) -> float | None:
        """Speed relative to the sensors'; None: as fast as possible."""
        return self._rate

    @rate.setter
    def rate(self, rate: float | None) -> None:
        if rate is not None and not 0 < rate < float("inf"):
            raise InputError(f"expected a rate above 0, got {rate}")
        self._rate, self._untied, self.touched = rate, True, True

    def pause(self) -> None:
        """Stand still after the event in hand."""
        self._paused = True

    def resume(self) -> None:
        """Go on."""
        self._paused, self._untied, self.touched = False, True, True

    def step(self, message_type: str = "") -> None:
        """Go on until a source has given a message of this type ("": any), then stand still again."""
        self._paused, self._step, self.touched = True, message_type, True

    # What the dispatcher does.

    def begin(self, time: int) -> None:
        """Tie the run's `time` [ns] to this moment."""
        self.begun = True
        self._untied = False
        self._time = time
        self._wall = clock.monotonic()

    def passed(self, message_type: str, time: int) -> None:
        """Note that an event has been handled at `time` [ns]."""
        if self._step in ("", message_type):
            self._step = None
        if self._untied and self.begun:
            self.begin(time)
        self.touched = self._step is not None

    def now(self, event_time: int | None) -> int:
        """Return how far the run's time may go [ns]: to the event when running free."""
        if self._free or not self.begun:
            return event_time if event_time is not None else self._time
        assert self._rate is not None
        return self._time + round((clock.monotonic() - self._wall) * self._rate)

    def wait(self, event_time: int | None, due: int | None, time: int = 0) -> float:
        """Return how long [s] nothing may happen, the run being at `time`; 0: the next event or timer is due."""
        if self._paused and self._step is None:
            return _LOOK
        if self._untied and self.begun:
            self.begin(time)
        if self._free or not self.begun:
            return 0.0 if event_time is not None else _LONGEST_WAIT
        times = [t for t in (event_time, due) if t is not None]
        if not times:
            return _LONGEST_WAIT
        assert self._rate is not None
        ahead = (min(times) - self.now(None)) / self._rate / 1e9
        return min(max(ahead, 0.0), _LONGEST_WAIT)

    @property
    def _free(self) -> bool:
        return self._rate is None or self._step is not None
