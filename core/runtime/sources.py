"""Pulled sources merged by (time, order in the YAML, source order), and timers.

A message that comes from a log of a run has its `time` and `seq` already: by these it is merged, so that
several sources of one log give its messages in the order in which they once arrived.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from knotwork.core.contracts import Driver
from knotwork.core.messages import UNSET, Message
from knotwork.core.runtime.timing import Clocked, Histogram

Item = tuple[str, Message] | int


def arrival(message: Message) -> int:
    """Return when a message is due [ns]: at its stamp, or when it was dispatched in the run that logged it."""
    return message.stamp if message.seq == UNSET else message.time


class Source:
    """A pulled driver and its next item.

    Attributes
    ----------
    time
        Running maximum of what the driver has given: stamps, or logged times [ns].
    item
        `(port, message)`, a bare int (nothing comes before that time), or None at the end.
    """

    def __init__(self, node: str, driver: Driver, clocked: Clocked, histogram: Histogram) -> None:
        self.node = node
        self.time = -(2**63)
        self._number = UNSET
        self.item: Item | None = None
        self._events: Iterator[Item] = iter(driver.events())
        self._clocked = clocked
        self._histogram = histogram

    def advance(self) -> None:
        """Pull the next item; the time it takes is the driver's."""
        self._clocked.start()
        try:
            self.item = next(self._events, None)
        finally:
            self._clocked.stop(self._histogram)
        if isinstance(self.item, int):
            self.time = max(self.time, self.item)
        elif self.item is not None:
            self.time = max(self.time, arrival(self.item[1]))
            self._number = self.item[1].seq

    def order(self) -> tuple[int, int]:
        """Return what sources are merged by."""
        return self.time, self._number

    def close(self) -> None:
        """Let a generator run its `finally` blocks."""
        close = getattr(self._events, "close", None)
        if close is not None:
            close()


@dataclass(slots=True)
class Timer:
    """A call that a node wants each `period` [ns] of the run's clock."""

    node: str
    period: int
    call: Callable[[int], None]
    due: int | None = None  # set by the first event


class Timers:
    """All timers of a run.

    Attributes
    ----------
    next
        When the next one fires [ns]; None before the first event, or without timers.
    """

    def __init__(self) -> None:
        self.next: int | None = None
        self._timers: list[Timer] = []

    def add(self, timer: Timer) -> None:
        """Register a timer; it first fires one period after the first event."""
        self._timers.append(timer)

    def begin(self, time: int) -> None:
        """Count from here [ns]."""
        for timer in self._timers:
            timer.due = time + timer.period
        self._plan()

    def due(self, time: int) -> Iterator[tuple[int, Timer]]:
        """Yield each firing up to `time`, in order of time, then of registration."""
        while self.next is not None and self.next <= time:
            timer = min((t for t in self._timers if t.due is not None), key=_due)
            at = _due(timer)
            timer.due = at + timer.period
            self._plan()
            yield at, timer

    def _plan(self) -> None:
        self.next = min((t.due for t in self._timers if t.due is not None), default=None)


def _due(timer: Timer) -> int:
    assert timer.due is not None
    return timer.due
