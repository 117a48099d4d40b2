"""A `Context` for tests: it records what a node does, and its clock is set by the test."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from knotwork.core.contracts import Level, Playback
from knotwork.core.errors import NodeError
from knotwork.core.manifest import Manifest
from knotwork.core.messages import Message


@dataclass(slots=True)
class _Timer:
    period: int
    call: Callable[[int], None]
    due: int | None = None  # set by the first event, as in a run


class RecordingContext:
    """Implements `knotwork.core.contracts.Context`; refuses what the runtime would refuse.

    Parameters
    ----------
    manifest
        Of the node under test: its config model validates `config` and `options`, its ports are enforced.
    config, options
        As they stand in a pipeline file.
    uses
        By the manifest's use names; absent ones are None.
    out
        The run's folder.

    Attributes
    ----------
    emitted
        `(port, message)` in order.
    reports
        `(level, text)` in order.
    counters
        Name to sum.
    time
        What `now()` returns [ns]; `advance` sets it and fires timers.
    """

    def __init__(
        self,
        manifest: Manifest,
        config: dict[str, Any] | None = None,
        *,
        out: Path,
        options: dict[str, Any] | None = None,
        uses: dict[str, Any] | None = None,
        name: str = "node",
        seed: int = 1,
    ) -> None:
        self.name = name
        self.config: Any = manifest.config.model_validate(config or {})
        self.manifest = manifest = manifest.of(self.config)
        self.options: Any = None if manifest.options is None else manifest.options.model_validate(options or {})
        self.uses: dict[str, Any] = dict.fromkeys(manifest.uses) | (uses or {})
        self.out = out
        self.seed = seed
        self.run: dict[str, Any] = {
            "pipeline": "conformance",
            "seed": 0,
            "config": "pipeline: conformance\n",
            "versions": {},
            "plugins": {name: manifest.name},
        }
        self.playback: Playback | None = None
        self.emitted: list[tuple[str, Message]] = []
        self.reports: list[tuple[Level, str]] = []
        self.counters: dict[str, int] = {}
        self.time = 0
        self.seq = 0
        self._timers: list[_Timer] = []

    def emit(self, port: str, message: Message) -> None:
        """Record a message.

        Raises
        ------
        NodeError
            The manifest does not declare the port, or declares another type or role for it.
        """
        check_output(self.manifest, self.name, port, message)
        self.emitted.append((port, message))

    def now(self) -> int:
        """Return the time the test has set [ns]."""
        return self.time

    def every(self, period: float, call: Callable[[int], None]) -> None:
        """Register a timer [s]; `advance` fires it."""
        if period <= 0:
            raise NodeError(self.name, f"asked for a timer every {period} s")
        self._timers.append(_Timer(max(round(period * 1e9), 1), call))

    def report(self, level: Level, text: str) -> None:
        """Record a report."""
        self.reports.append((level, text))

    def count(self, name: str, by: int = 1) -> None:
        """Add to a counter."""
        self.counters[name] = self.counters.get(name, 0) + by

    @contextmanager
    def measure(self, name: str = "") -> Iterator[None]:
        """Do nothing around a block."""
        yield

    # ---- what the test does

    def advance(self, time: int) -> None:
        """Set the clock to `time` [ns] (never back) and fire the timers that are due on the way."""
        time = max(time, self.time)
        while True:
            due = [t for t in self._timers if t.due is not None and t.due <= time]
            if not due:
                break
            timer = min(due, key=lambda t: t.due or 0)
            at = timer.due or 0
            self.time = max(self.time, at)
            timer.due = at + timer.period
            timer.call(at)
        self.time = time
        for timer in self._timers:
            if timer.due is None:
                timer.due = time + timer.period

    def give(self, node: Any, port: str, message: Message) -> None:
        """Hand a message to a node as the dispatcher would: clock, timers, `time`, `seq`, `on_<port>`."""
        self.advance(message.stamp)
        sealed = message.sealed(self.time, self.seq)
        self.seq += 1
        getattr(node, f"on_{port.replace('-', '_')}")(sealed)

    def messages(self, port: str) -> list[Any]:
        """Return what was emitted on a port."""
        return [message for name, message in self.emitted if name == port]


def check_output(manifest: Manifest, node: str, port: str, message: Message) -> None:
    """Refuse a message that a port's declaration does not allow, as the runtime does."""
    declared = manifest.outputs.get(port)
    if declared is None:
        known = ", ".join(manifest.outputs) or "none"
        raise NodeError(node, f"emitted on {port!r}, which its manifest does not declare (outputs: {known})")
    role = getattr(message, "role", declared.role)
    if message.type_name != declared.message or role != declared.role:
        got = f"{message.type_name} ({role})" if role else message.type_name
        wanted = f"{declared.message} ({declared.role})" if declared.role else declared.message
        raise NodeError(node, f"gave a {got} on {port!r}, declared as {wanted}")
