"""The one dispatcher: a source event and all it triggers end before the next begins, in every clock."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Event as Flag
from threading import get_ident
from typing import Any

from knotwork.core import clock
from knotwork.core.errors import NodeError
from knotwork.core.graph import Stream
from knotwork.core.messages import Event, Message
from knotwork.core.runtime.blame import blame, guarded
from knotwork.core.runtime.inbox import Channel, Inbox
from knotwork.core.runtime.pace import Pace
from knotwork.core.runtime.sink_worker import SinkWorker
from knotwork.core.runtime.sources import Source, Timers, arrival
from knotwork.core.runtime.timing import Clocked, Histogram


@dataclass(slots=True)
class Outlet:
    """A stream, who takes it, and the bounded queue for messages from another thread."""

    stream: Stream
    name: str
    channel: Channel
    handlers: list[tuple[str, Callable[[Any], None], Histogram]] = field(default_factory=list)
    sinks: list[SinkWorker] = field(default_factory=list)


class Dispatcher:
    """Gives each message its `time` and `seq` and hands it to its takers.

    Attributes
    ----------
    time
        `time` of the event in hand [ns].
    seq
        Number of the next message.
    pace
        What the run waits for.
    first_event
        When the first event was dispatched, monotonic [ns]; 0 before.
    """

    def __init__(self, rate: float | None, stop: Flag, clocked: Clocked) -> None:
        self.time = 0
        self.seq = 0
        self.first_event = 0
        self.timers = Timers()
        self.taps: list[Callable[[str, Message], None]] = []
        self.clocked = clocked
        self._inbox = Inbox()
        self._stop = stop
        self.pace = Pace(rate)
        self._pending: deque[tuple[Outlet, Message]] = deque()
        self._thread = get_ident()

    @property
    def here(self) -> bool:
        """Return whether the caller is in the dispatcher's thread."""
        return get_ident() == self._thread

    def emit(self, outlet: Outlet, message: Message) -> None:
        """Take a message from a node: at once in this thread, through the bounded inbox from another."""
        if self.here:
            self._pending.append((outlet, message))
        else:
            self._inbox.put(outlet, message)

    def run(self, sources: list[Source], outlet_of: Callable[[str, str], Outlet], live: bool) -> None:
        """Dispatch until the sources end or a stop is asked for; with `live`, only until a stop."""
        for each in sources:
            self._pull(each)
        while not self._stop.is_set():
            source = _earliest(sources)
            if source is None and not live and not self._inbox:
                return
            event_time = None if source is None else max(source.time, self.time)
            wait = self.pace.wait(event_time, self.timers.next, self.time)
            if wait > 0 or self._inbox:
                self._take(wait)
                continue
            now = self.pace.now(event_time)
            until = now if event_time is None else min(now, event_time)
            if self.timers.next is not None and self.timers.next <= until:
                self._fire(until)
            if source is not None and event_time is not None and event_time <= now:
                self._advance(source, event_time, outlet_of)

    def close(self) -> None:
        """Refuse messages from other threads from now on; of those that wait only events are kept for `drain`."""
        self._inbox.close()
        while (entry := self._inbox.take(0.0)) is not None:
            if isinstance(entry.message, Event):
                self._pending.append((entry.outlet, entry.message))

    def drain(self) -> None:
        """Handle everything that is pending, first in, first out, and all it gives rise to."""
        pending = self._pending
        clocked = self.clocked
        while pending:
            outlet, message = pending.popleft()
            stream = outlet.stream
            if message.type_name != stream.message or getattr(message, "role", stream.role) != stream.role:
                got = Stream("", "", message.type_name, getattr(message, "role", "")).what
                raise NodeError(stream.node, f"gave a {got} on {stream.port!r}, declared as {stream.what}")
            message = message.sealed(self.time, self.seq)
            self.seq += 1
            for node, handler, histogram in outlet.handlers:
                clocked.start()
                try:
                    handler(message)
                except Exception as error:
                    raise blame(node, error) from error
                finally:
                    clocked.stop(histogram)
            for tap in self.taps:
                tap(outlet.name, message)
            if outlet.sinks:
                size = message.nbytes
                for worker in outlet.sinks:
                    worker.put(outlet.name, message, size)

    def _take(self, wait: float) -> None:
        entry = self._inbox.take(wait)
        if entry is not None and entry.message is not None:
            if not isinstance(entry.message, Event):  # a remark may come before there is a measured time
                time = max(self.time, entry.message.stamp)
                self._begin(time)
                self._fire(time)  # so that `time` alone tells which timers came before: a replay needs no more
            self._event(entry.outlet, entry.message)

    def _advance(self, source: Source, time: int, outlet_of: Callable[[str, str], Outlet]) -> None:
        self._begin(time)
        self.time = time
        item = source.item
        if item is not None and not isinstance(item, int):
            self._event(outlet_of(source.node, item[0]), item[1])
        self._pull(source)

    def _begin(self, time: int) -> None:
        if not self.pace.begun:
            self.pace.begin(time)
            self.timers.begin(time)
            self.first_event = clock.monotonic()

    def _pull(self, source: Source) -> None:
        guarded(source.node, source.advance)
        self.drain()  # what the driver reported while it was pulled

    def _event(self, outlet: Outlet, message: Message) -> None:
        self.time = max(self.time, arrival(message))
        self.seq = max(self.seq, message.seq)  # a logged message keeps its number
        self._pending.append((outlet, message))
        self.drain()
        if self.pace.touched:
            self.pace.passed(message.type_name, self.time)

    def _fire(self, until: int) -> None:
        for at, timer in self.timers.due(until):
            self.time = max(self.time, at)
            try:
                timer.call(at)
            except Exception as error:
                raise blame(timer.node, error) from error
            self.drain()


def _earliest(sources: list[Source]) -> Source | None:
    """Return the source whose item comes first (`Source.order`), of equals the first in the list."""
    earliest: Source | None = None
    for source in sources:
        if source.item is not None and (earliest is None or source.order() < earliest.order()):
            earliest = source
    return earliest
