"""What a node sees of its run."""

import hashlib
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from threading import get_ident
from typing import TYPE_CHECKING, Any

from knotwork.core import clock
from knotwork.core.contracts import Level
from knotwork.core.errors import NodeError
from knotwork.core.messages import Message
from knotwork.core.runtime.inbox import Channel
from knotwork.core.runtime.sources import Timer
from knotwork.core.runtime.timing import Clocked, Histogram, Span

if TYPE_CHECKING:
    from knotwork.core.config import NodeSpec

    from knotwork.core.runtime.run import Outlet, Run


class NodeContext:
    """The runtime's side of `knotwork.core.contracts.Context` for one node."""

    def __init__(self, run: "Run", spec: "NodeSpec", clocked: Clocked) -> None:
        self.name = spec.name
        self.config: Any = spec.config
        self.options: Any = spec.options
        self.uses: dict[str, Any] = dict.fromkeys(spec.manifest.uses)
        self.out: Path = run.out
        self.seed = int.from_bytes(hashlib.sha256(f"{run.pipeline.seed}/{spec.name}".encode()).digest()[:8], "big")
        self.run: dict[str, Any] = run.header
        self.outlets: dict[str, Outlet] = {}
        self.channels: dict[str, Channel] = {}
        self.counters: dict[str, int] = {}
        self.histograms: dict[str, Histogram] = {}
        self._run = run
        self._clocked = clocked

    def emit(self, port: str, message: Message) -> None:
        """Give a message on an output port; from another thread it waits in a bounded queue."""
        outlet = self.outlets.get(port)
        if outlet is None:
            known = ", ".join(self.outlets) or "none"
            raise NodeError(self.name, f"emitted on {port!r}, which its manifest does not declare (outputs: {known})")
        if get_ident() == self._run.thread:
            self._run.pending.append((outlet, message))
        else:
            self._run.inbox.put(self.channels[port], message, clock.monotonic())

    def now(self) -> int:
        """Return the `time` of the event in hand [ns]."""
        return self._run.time

    def every(self, period: float, call: Callable[[int], None]) -> None:
        """Call `call(time)` each `period` [s] of the run's clock; only before the run starts."""
        self._run.timers.add(Timer(self.name, round(period * 1e9), call))

    def report(self, level: Level, text: str) -> None:
        """Tell a person: one line on the terminal and an `event` message in the log."""
        self._run.report(self.name, level, text)

    def count(self, name: str, by: int = 1) -> None:
        """Add to a counter of this node."""
        self.counters[name] = self.counters.get(name, 0) + by

    def measure(self, name: str = "") -> AbstractContextManager[None]:
        """Time a block under `node.name`."""
        key = f"{self.name}.{name}" if name else self.name
        histogram = self.histograms.get(key)
        if histogram is None:
            histogram = self.histograms[key] = Histogram()
        return Span(self._clocked, histogram)
