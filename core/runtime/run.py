"""One run of one pipeline: configure, warm, open, dispatch, stop motion, drain, close."""

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Event as Flag
from threading import Lock
from typing import TYPE_CHECKING, Any

from knotwork.core import clock
from knotwork.core.collector import settled
from knotwork.core.contracts import Driver, Level
from knotwork.core.errors import InputError, KnotworkError, NodeError
from knotwork.core.graph import Graph, Stream
from knotwork.core.messages import Event, Message, Statistics
from knotwork.core.registry import Registry
from knotwork.core.runtime.assembly import Assembly, assemble
from knotwork.core.runtime.blame import blame, guarded
from knotwork.core.runtime.dispatcher import Dispatcher, Outlet
from knotwork.core.runtime.inbox import Channel
from knotwork.core.runtime.measurement import measure
from knotwork.core.runtime.sink_worker import monotonic_clocked
from knotwork.core.runtime.sources import Source, Timer

if TYPE_CHECKING:
    from knotwork.core.config import Pipeline

RUNTIME = "runtime"  # the node name of the run's own streams
_STATISTICS_EVERY = 10.0  # s of the run's clock
_DRAIN_TIMEOUT = 60.0  # s
_EVENTS = 1000  # reports of other threads that wait to be logged
_LINES_A_NODE = 20  # printed reports; all of them are in the log


@dataclass(frozen=True, slots=True)
class Result:
    """How a run ended; `exit_code` is 0 (done), 1 (failed) or 2 (the input was wrong)."""

    exit_code: int
    statistics: dict[str, Any]
    failure: KnotworkError | None
    trace: str  # for the run's log file, never for the terminal


class Run:
    """Executes a pipeline once.

    Parameters
    ----------
    pipeline, graph, registry
        What to run.
    out
        Folder for everything the run writes; made if missing.
    rate
        Speed relative to the sensors' for pulled sources; None as fast as possible.
    console
        Called with node, level and text of each report, from any thread.
    header
        What a log's header says of the run.
    """

    def __init__(
        self,
        pipeline: "Pipeline",
        graph: Graph,
        registry: Registry,
        out: Path,
        *,
        rate: float | None = None,
        console: Callable[[str, Level, str], None] | None = None,
        header: dict[str, Any] | None = None,
    ) -> None:
        self.pipeline = pipeline
        self.graph = graph
        self.out = out
        self._header = header or {}
        self._registry = registry
        self._console = console or (lambda node, level, text: None)
        self._stop = Flag()
        self._stopped_by = ""
        rate = 1.0 if rate is None and graph.clock == "real" else rate
        self._dispatcher = Dispatcher(rate, self._stop, monotonic_clocked())
        self._events = _own("events", "event", Channel(_EVENTS, "drop-oldest"))
        self._statistics = _own("statistics", "statistics", Channel(1, "latest"))
        self._assembly = Assembly({}, {}, {})
        self._opened: list[str] = []
        self._failure: KnotworkError | None = None
        self._begun = clock.monotonic() - clock.since_process_start()
        self._lock = Lock()
        self._errors = 0
        self._lines: dict[str, int] = {}

    @property
    def messages(self) -> int:
        """Return how many messages have been dispatched."""
        return self._dispatcher.seq

    def progress(self) -> float | None:
        """Return the share of the pulled sources that has been given, in [0, 1]; None when unknown."""
        drivers = [n for n in list(self._assembly.nodes.values()) if isinstance(n, Driver)]
        return min((p for p in (d.progress() for d in drivers) if p is not None), default=None)

    def stop(self, reason: str) -> None:
        """Ask the run to end gracefully; safe from any thread and from a signal handler."""
        self._stopped_by = reason
        self._stop.set()

    def stop_motion(self) -> None:
        """Stop everything that moves."""
        for name, node in self._assembly.nodes.items():
            self._on_the_way_out(name, node.stop_motion)

    def tap(self, call: Callable[[str, Message], None]) -> None:
        """Give a tool every message, in the dispatcher's thread."""
        self._dispatcher.taps.append(call)

    def report(self, node: str, level: Level, text: str) -> None:
        """Print a report and log it as an `event` message.

        What a sink says from its thread is printed only: logging it would give the sink more to fail at.
        """
        with self._lock:
            self._errors += level == "error"
            lines = self._lines[node] = self._lines.get(node, 0) + 1
        if lines <= _LINES_A_NODE:
            self._console(node, level, text)
        if lines == _LINES_A_NODE:
            self._console(node, level, "further reports of this node are only in the log")
        if self._dispatcher.here or node not in self._assembly.workers:
            event = Event(stamp=self._dispatcher.time, node=node, level=level, text=text)
            self._dispatcher.emit(self._events, event)

    def warm(self) -> None:
        """Build all nodes and compile their kernels; opens nothing."""
        try:
            self.out.mkdir(parents=True, exist_ok=True)
            (self.out / "run.log").touch()  # a folder that cannot be written to is found out now, not at the end
        except OSError as error:
            raise InputError(f"cannot make or write the run's folder: {error.strerror}", where=str(self.out)) from error
        self._assembly = assemble(
            self.pipeline,
            self.graph,
            self._registry,
            self._dispatcher,
            self.report,
            [self._events, self._statistics],
            out=self.out,
            header=self._header,
        )
        for name, node in self._assembly.nodes.items():
            guarded(name, node.warm)

    def execute(self) -> Result:
        """Run to the end of the sources, a stop, or a failure; never raises for a node's mistakes."""
        try:
            self.warm()
            for name, node in self._assembly.nodes.items():
                self._opened.append(name)
                guarded(name, node.open)
            self._registry.hooks.hook.knotwork_run_started(run=self)
            with settled(collect=self.graph.clock == "real"):
                self._dispatch()
        except KnotworkError as error:
            self._fail(error)
        self._finish()
        self._close()
        code = self._failure.exit_code if self._failure is not None else int(self._errors > 0)
        trace = "".join(traceback.format_exception(self._failure)) if self._failure is not None else ""
        return Result(code, self.statistics(), self._failure, trace)

    def statistics(self, *, histograms: bool = False) -> dict[str, Any]:
        """Return what was measured so far."""
        figures = measure(self._assembly, self._begun, self._dispatcher.first_event, histograms=histograms)
        return {"clock": self.graph.clock, "stopped_by": self._stopped_by} | figures

    def _dispatch(self) -> None:
        for worker in self._assembly.workers.values():
            worker.start()
        self._dispatcher.timers.add(Timer(RUNTIME, round(_STATISTICS_EVERY * 1e9), self._give_statistics))
        drivers = [(n, d) for n, d in self._assembly.nodes.items() if isinstance(d, Driver)]
        drivers.sort(key=lambda named: list(self.pipeline.nodes).index(named[0]))
        pushing = [d for n, d in drivers if self.pipeline.nodes[n].manifest.push]
        sources = [
            Source(n, d, self._dispatcher.clocked, self._assembly.contexts[n].histogram())
            for n, d in drivers
            if d not in pushing
        ]
        try:
            for driver in pushing:
                driver.start()
            self._dispatcher.run(sources, self._assembly.outlet, live=bool(pushing))
        finally:
            self.stop_motion()
            for driver in pushing:
                self._on_the_way_out(driver.context.name, driver.stop)
            for source in sources:
                self._on_the_way_out(source.node, source.close)

    def _give_statistics(self, time: int) -> None:
        self._dispatcher.emit(self._statistics, Statistics(stamp=time, data=self.statistics()))

    def _finish(self) -> None:
        """Let estimators give their last messages, then sinks write everything out."""
        self._dispatcher.close()
        failed = self._failure.node if isinstance(self._failure, NodeError) else None
        for name in self.graph.finish_order:
            if name in self._opened and name not in self._assembly.workers and name != failed:
                self._on_the_way_out(name, self._assembly.nodes[name].finish)
                self._on_the_way_out(name, self._dispatcher.drain)
        self._on_the_way_out(RUNTIME, self._dispatcher.drain)
        if self._opened:
            time, seq = self._dispatcher.time, self._dispatcher.seq
            last = Statistics(stamp=time, data=self.statistics(histograms=True), final=True).sealed(time, seq)
            for worker in self._statistics.sinks:
                worker.put(self._statistics.name, last, last.nbytes)
        for name, worker in self._assembly.workers.items():
            if name in self._opened and not worker.finish(_DRAIN_TIMEOUT):
                self.report(name, "error", f"not done within {_DRAIN_TIMEOUT:.0f} s; its last messages are lost")

    def _close(self) -> None:
        hook = self._registry.hooks.hook
        self._on_the_way_out(RUNTIME, lambda: hook.knotwork_run_finished(run=self, statistics=self.statistics()))
        for name in reversed(self._opened):
            self._on_the_way_out(name, self._assembly.nodes[name].close)

    def _on_the_way_out(self, node: str, call: Callable[[], Any]) -> None:
        """Call what must be called whatever happened before; a second failure never hides the first."""
        try:
            call()
        except Exception as error:  # noqa: BLE001 - everything else must still be closed
            self._fail(blame(node, error))

    def _fail(self, error: KnotworkError) -> None:
        if self._failure is None:
            self._failure = error
        else:
            self.report(getattr(error, "node", RUNTIME), "error", error.message)


def _own(port: str, message: str, channel: Channel) -> Outlet:
    return Outlet(Stream(RUNTIME, port, message, ""), f"{RUNTIME}.{port}", channel)
