"""Compares what a run gives with what a log has, message by message, in the log's order."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from knotwork.core import codec
from knotwork.core.log.reader import Log
from knotwork.core.message_types import is_wall_clock
from knotwork.core.messages import Event, Message
from knotwork.core.stamps import format_seconds

_EVENTS = "runtime.events"


@dataclass(frozen=True, slots=True)
class Difference:
    """The first message that is not the same."""

    stream: str
    stamp: int
    text: str

    def __str__(self) -> str:
        """Render as one line."""
        return f"{self.stream}, stamp {format_seconds(self.stamp)} s: {self.text}"


class Comparison:
    """Takes a run's messages by `see`; the first difference ends it.

    `seq` is not compared: a driver's reports take numbers too, and a replay has no driver.

    Parameters
    ----------
    logs
        What was logged, in order.
    nodes
        The nodes that run again.
    recorded
        Whether the log's recorder took a stream.
    whole
        The log has its end: more messages than it has are a difference.
    differs
        Called once, at the first difference.
    """

    def __init__(
        self,
        logs: list[Log],
        nodes: set[str],
        recorded: Callable[[str], bool],
        whole: bool,
        differs: Callable[[], None],
    ) -> None:
        self.difference: Difference | None = None
        self.same: dict[str, int] = {}
        self.missing = 0  # dispatched messages that the log lacks, as far as it was compared
        self.beyond = 0  # messages after the end of a log that was cut short
        self._nodes = nodes
        self._recorded = recorded
        self._whole = whole
        self._differs = differs
        self._logged = self._expected(logs)

    def see(self, stream: str, message: Message) -> None:
        """Compare one message of the run."""
        if self.difference is not None or not self._compared(stream, message):
            return
        logged = next(self._logged, None)
        if logged is None:
            self.beyond += 1
            if self._whole:
                self._found(stream, message, "the log has ended, the run goes on")
        elif logged[0] != stream:
            self._found(*logged, f"logged here, now comes {stream} with stamp {format_seconds(message.stamp)} s")
        elif text := difference(logged[1], message):
            self._found(stream, logged[1], text)
        else:
            self.same[stream] = self.same.get(stream, 0) + 1

    def finish(self) -> None:
        """Compare the ends."""
        if self.difference is None and (left := next(self._logged, None)) is not None:
            self._found(*left, "logged, but the run has ended before it")

    def _found(self, stream: str, message: Message, text: str) -> None:
        self.difference = Difference(stream, message.stamp, text)
        self._differs()

    def _expected(self, logs: list[Log]) -> Iterator[tuple[str, Message]]:
        last = -1
        for log in logs:
            for stream, message in log.messages():
                self.missing += max(message.seq - last - 1, 0)
                last = max(last, message.seq)
                if self._compared(stream, message):
                    yield stream, message

    def _compared(self, stream: str, message: Message) -> bool:
        if is_wall_clock(message.type_name) or not self._recorded(stream):
            return False
        if stream == _EVENTS:
            return isinstance(message, Event) and message.node in self._nodes
        return stream.partition(".")[0] in self._nodes


def difference(logged: Message, now: Message) -> str:
    """Say in which field two messages differ first; "" when they do not."""
    now = codec.decode(type(now), codec.encode(now))
    if type(logged) is not type(now):
        return f"logged a {logged.type_name}, now a {now.type_name}"
    for field in fields(logged):
        if field.name != "seq":
            a, b = getattr(logged, field.name), getattr(now, field.name)
            if text := _differing(a, b):
                return f"field {field.name}{text}"
    return ""


def _differing(a: Any, b: Any) -> str:
    """Compare two values bit by bit; NaN is NaN."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        if a.dtype != b.dtype or a.shape != b.shape:
            return f": logged {a.dtype} {a.shape}, now {b.dtype} {b.shape}"
        if a.tobytes() == b.tobytes():
            return ""
        cells = np.frombuffer(a.tobytes(), np.uint8).reshape(a.size, -1) != np.frombuffer(
            b.tobytes(), np.uint8
        ).reshape(b.size, -1)
        at = int(np.argmax(cells.any(axis=1)))
        index = ", ".join(str(i) for i in np.unravel_index(at, a.shape))
        return f"[{index}]: logged {a.flat[at].item()!r}, now {b.flat[at].item()!r}"
    if isinstance(a, float) and isinstance(b, float):
        same = np.float64(a).tobytes() == np.float64(b).tobytes() or (a != a and b != b)
        return "" if same else f": logged {a!r}, now {b!r}"
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray) or repr(a) != repr(b):
        return f": logged {_short(a)}, now {_short(b)}"
    return ""


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
