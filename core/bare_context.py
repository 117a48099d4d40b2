"""A node outside of a run: for commands and benches that build one by its plugin and call it themselves."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from knotwork.core.contracts import Level, Playback
from knotwork.core.messages import Message


@dataclass
class BareContext:
    """Implements `knotwork.core.contracts.Context`: time is what it is set to, what the node gives is kept.

    Attributes
    ----------
    time
        What `now()` returns [ns].
    sent
        `(port, message)` in order.
    reports
        `(level, text)` in order.
    """

    name: str
    config: Any
    options: Any = None
    uses: dict[str, Any] = field(default_factory=dict)
    out: Path = Path()
    seed: int = 0
    run: dict[str, Any] = field(default_factory=dict)
    playback: Playback | None = None
    time: int = 0
    sent: list[tuple[str, Message]] = field(default_factory=list)
    reports: list[tuple[Level, str]] = field(default_factory=list)

    def emit(self, port: str, message: Message) -> None:
        """Keep a message."""
        self.sent.append((port, message))

    def now(self) -> int:
        """Return the time that was set [ns]."""
        return self.time

    def every(self, period: float, call: Callable[[int], None]) -> None:
        """Never call."""

    def report(self, level: Level, text: str) -> None:
        """Keep a line."""
        self.reports.append((level, text))

    def count(self, name: str, by: int = 1) -> None:
        """Count nothing."""

    def measure(self, name: str = "") -> AbstractContextManager[None]:
        """Measure nothing."""
        return nullcontext()
