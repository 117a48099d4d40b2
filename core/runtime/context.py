"""What a node sees of its run."""

import hashlib
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from knotwork.core.contracts import Level, Playback
from knotwork.core.errors import NodeError
from knotwork.core.messages import Message
from knotwork.core.runtime.dispatcher import Dispatcher, Outlet
from knotwork.core.runtime.sources import Timer
from knotwork.core.runtime.timing import Clocked, Histogram, Span

if TYPE_CHECKING:
    from knotwork.core.config import NodeSpec

Report = Callable[[str, Level, str], None]  # node, level, text


class NodeContext:
    """The runtime's side of `knotwork.core.contracts.Context` for one node."""

    def __init__(
        self,
        spec: "NodeSpec",
        dispatcher: Dispatcher,
        clocked: Clocked,
        report: Report,
        *,
        out: Path,
        seed: int,
        header: dict[str, Any],
        playback: Playback | None = None,
    ) -> None:
        self.name = spec.name
        self.config: Any = spec.config
        self.options: Any = spec.options
        self.uses: dict[str, Any] = dict.fromkeys(spec.manifest.uses)
        self.out = out
        self.seed = int.from_bytes(hashlib.sha256(f"{seed}/{spec.name}".encode()).digest()[:8], "big")
        self.run = header
        self.playback = playback
        self.clocked = clocked
        self.outlets: dict[str, Outlet] = {}
        self.counters: dict[str, int] = {}
        self.histograms: dict[str, Histogram] = {}
        self._dispatcher = dispatcher
        self._report = report

    def outlet(self, port: str) -> Outlet:
        """Return the stream of an output port."""
        outlet = self.outlets.get(port)
        if outlet is None:
            known = ", ".join(self.outlets) or "none"
            raise NodeError(self.name, f"gave a message on {port!r}, which its manifest does not declare ({known})")
        return outlet

    def emit(self, port: str, message: Message) -> None:
        """Give a message on an output port; from another thread it waits in a bounded queue."""
        self._dispatcher.emit(self.outlet(port), message)

    def now(self) -> int:
        """Return the `time` of the event in hand [ns]."""
        return self._dispatcher.time

    def every(self, period: float, call: Callable[[int], None]) -> None:
        """Call `call(time)` each `period` [s] of the run's clock; only before the run starts."""
        self._dispatcher.timers.add(Timer(self.name, round(period * 1e9), call))

    def report(self, level: Level, text: str) -> None:
        """Tell a person: one line on the terminal and an `event` message in the log."""
        self._report(self.name, level, text)

    def count(self, name: str, by: int = 1) -> None:
        """Add to a counter of this node."""
        self.counters[name] = self.counters.get(name, 0) + by

    def histogram(self, name: str = "") -> Histogram:
        """Return the histogram of this node, or of `node.name`."""
        key = f"{self.name}.{name}" if name else self.name
        histogram = self.histograms.get(key)
        if histogram is None:
            histogram = self.histograms[key] = Histogram()
        return histogram

    def measure(self, name: str = "") -> AbstractContextManager[None]:
        """Time a block under `node.name`."""
        return Span(self.clocked, self.histogram(name))
