"""A sink's own thread behind a bounded queue, so that no sink slows an estimator."""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from threading import Condition, Thread

from knotwork.core import clock
from knotwork.core.contracts import Sink
from knotwork.core.messages import Message
from knotwork.core.runtime.inbox import Policy
from knotwork.core.runtime.timing import Clocked, Histogram

# Each hand-over of the interpreter costs the dispatcher some 50 us and warm caches, so a worker is woken seldom
# when much comes at once; when little comes it looks by itself.
_WAKE_AT = 256  # messages
_LOOK_EVERY = 0.05  # s
_GIVE_UP_AFTER = 10  # failures in a row
_BYTES = 256 << 20  # that may wait: ten thousand scans are little, ten thousand images are not

Failed = Callable[[Exception, bool], None]  # the error, and whether the sink is given up


class SinkWorker:
    """Hands messages to a sink; an error of the sink is reported and counted, the run goes on."""

    def __init__(
        self,
        sink: Sink,
        size: int,
        policy: Policy,
        clocked: Clocked,
        histogram: Histogram,
        failed: Failed,
        dropping: Callable[[], None] = lambda: None,
    ) -> None:
        self.drops = 0
        self.failures = 0
        self.backlog_max = 0
        self._sink = sink
        self._size = 1 if policy == "latest" else size
        self._wake_at = 1 if sink.prompt else _WAKE_AT
        self._policy = policy
        self._clocked = clocked
        self._histogram = histogram
        self._failed = failed
        self._dropping = dropping  # called at the first drop, in the dispatcher's thread
        self._came = self._went = self._thrown = 0  # bytes; each is counted by one thread only
        self._taken = 0  # messages
        self._in_a_row = self._failed_at = 0  # failures without a success between them; `_taken` at the last one
        self._queue: deque[tuple[str, Message, int]] = deque()  # stream, message, bytes
        self._changed = Condition()
        self._draining = False
        self._thread = Thread(target=self._work, name=f"sink {sink.context.name}", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def put(self, stream: str, message: Message, size: int) -> None:
        """Accept one message of `size` bytes."""
        queue = self._queue
        self._came += size
        waiting = len(queue)
        if waiting >= self._size or self._came - self._went - self._thrown > _BYTES:
            self._make_room()
            waiting = len(queue)
        queue.append((stream, message, size))
        waiting += 1
        if waiting == self._wake_at or waiting >= self._size:
            with self._changed:
                self._changed.notify_all()

    @property
    def backlog(self) -> int:
        """Messages that wait."""
        return len(self._queue)

    @property
    def _full(self) -> bool:
        waiting = len(self._queue)
        return waiting >= self._size or (waiting > 0 and self._came - self._went - self._thrown > _BYTES)

    def _make_room(self) -> None:
        if self._policy == "block":
            with self._changed:
                while self._full and self._thread.is_alive():
                    self._changed.notify_all()
                    self._changed.wait(_LOOK_EVERY)
            return
        with suppress(IndexError):  # the worker was faster
            while self._full:
                self._thrown += self._queue.popleft()[2]
                self.drops += 1
                if self.drops == 1:
                    self._dropping()

    def finish(self, timeout: float) -> bool:
        """Handle everything that waits, then the sink's `finish`; False when it did not end in time [s]."""
        with self._changed:
            self._draining = True
            self._changed.notify_all()
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _work(self) -> None:
        queue = self._queue
        while True:
            self.backlog_max = max(self.backlog_max, len(queue))
            while queue:
                self._hand(self._waiting())
            with self._changed:
                self._changed.notify_all()
                if not queue:
                    if self._draining:
                        break
                    self._changed.wait(_LOOK_EVERY)
        self._last()

    def _waiting(self) -> Iterator[tuple[str, Message]]:
        """Take what waits now; the time until the next one is asked for is this one's."""
        queue, now = self._queue, self._clocked.now
        ends: list[int] = []
        self._clocked.start()
        try:
            for _ in range(len(queue)):
                try:
                    stream, message, size = queue.popleft()
                except IndexError:  # dropped meanwhile, to make room
                    return
                self._taken += 1
                try:
                    yield stream, message
                finally:
                    self._went += size
                    ends.append(now())
        finally:
            self._clocked.stop_each(self._histogram, ends)

    def _hand(self, messages: Iterator[tuple[str, Message]]) -> None:
        while True:
            if self._in_a_row >= _GIVE_UP_AFTER:
                self.drops += sum(1 for _ in messages)
                return
            try:
                self._sink.on_messages(messages)
            except Exception as error:  # noqa: BLE001 - a sink must not end the run
                if self._taken > self._failed_at + 1:
                    self._in_a_row = 0
                self._failed_at = self._taken
                self._failure(error)
            else:
                return

    def _last(self) -> None:
        try:
            self._sink.finish()
        except Exception as error:  # noqa: BLE001
            self._failure(error)

    def _failure(self, error: Exception) -> None:
        self.failures += 1
        self._in_a_row += 1
        self._failed(error, self._in_a_row == _GIVE_UP_AFTER)


def monotonic_clocked() -> Clocked:
    """Return the spans of a new thread."""
    return Clocked(clock.monotonic)
