"""One run of one pipeline: configure, warm, open, dispatch, stop motion, drain, close."""

import resource
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event as Flag
from threading import Lock, get_ident
from typing import TYPE_CHECKING, Any

from knotwork.core import clock
from knotwork.core.contracts import Driver, Level, Node, Sink
from knotwork.core.errors import InputError, KnotworkError, NodeError
from knotwork.core.graph import Graph, Stream
from knotwork.core.messages import Event, Message, Statistics
from knotwork.core.registry import Registry
from knotwork.core.runtime.context import NodeContext
from knotwork.core.runtime.inbox import Channel, Inbox
from knotwork.core.runtime.sink_worker import SinkWorker, monotonic_clocked
from knotwork.core.runtime.sources import Source, Timers
from knotwork.core.runtime.timing import Histogram

if TYPE_CHECKING:
    from knotwork.core.config import NodeSpec, Pipeline

RUNTIME = "runtime"  # the node name of the run's own messages
_STATISTICS_EVERY = 10.0  # s of the run's clock
_DRAIN_TIMEOUT = 60.0  # s
_LINES_A_NODE = 20  # printed reports; all of them are in the log

Console = Callable[[str, Level, str], None]  # node, level, text


@dataclass(slots=True)
class Outlet:
    """A stream and who takes it."""

    stream: Stream
    name: str
    handlers: list[tuple[str, Callable[[Any], None], Histogram]] = field(default_factory=list)
    sinks: list[SinkWorker] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Result:
    """How a run ended; `exit_code` is 0 (done), 1 (failed) or 2 (the input was wrong)."""

    exit_code: int
    statistics: dict[str, Any]
    failure: KnotworkError | None
    trace: str = ""


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
        Called with each report, from any thread.
    """

    def __init__(
        self,
        pipeline: "Pipeline",
        graph: Graph,
        registry: Registry,
        out: Path,
        *,
        rate: float | None = None,
        console: Console | None = None,
        header: dict[str, Any] | None = None,
    ) -> None:
        self.pipeline = pipeline
        self.graph = graph
        self.out = out
        self.header = header or {}
        self.time = 0
        self.seq = 0
        self.thread = get_ident()
        self.pending: deque[tuple[Outlet, Message]] = deque()
        self.inbox = Inbox()
        self.timers = Timers()
        self.nodes: dict[str, Node] = {}
        self.progress: Callable[[], float | None] = lambda: None
        self._registry = registry
        self._rate = 1.0 if rate is None and graph.clock == "real" else rate
        self._console = console or (lambda node, level, text: None)
        self._contexts: dict[str, NodeContext] = {}
        self._workers: dict[str, SinkWorker] = {}
        self._clocked = monotonic_clocked()
        self._taps: list[Callable[[str, Message], None]] = []
        self._stop = Flag()
        self._stopped_by = ""
        self._failure: KnotworkError | None = None
        self._trace = ""
        self._lock = Lock()
        self._errors = 0
        self._lines: dict[str, int] = {}
        self._begun = clock.monotonic()
        self._first_event = 0
        self._opened: list[str] = []
        self._events = Outlet(Stream(RUNTIME, "events", "event", ""), f"{RUNTIME}.events")
        self._statistics = Outlet(Stream(RUNTIME, "statistics", "statistics", ""), f"{RUNTIME}.statistics")

    # ---- what tools and signal handlers may call

    def stop(self, reason: str) -> None:
        """Ask the run to end gracefully; safe from any thread and from a signal handler."""
        self._stopped_by = reason
        self._stop.set()

    def tap(self, call: Callable[[str, Message], None]) -> None:
        """Give a tool every message, in the dispatcher's thread."""
        self._taps.append(call)

    def report(self, node: str, level: Level, text: str) -> None:
        """Print a report and, from the dispatcher's thread, log it as an `event` message."""
        with self._lock:
            self._errors += level == "error"
            lines = self._lines[node] = self._lines.get(node, 0) + 1
        if lines <= _LINES_A_NODE:
            self._console(node, level, text)
            if lines == _LINES_A_NODE:
                self._console(node, level, "further reports of this node are only in the log")
        if get_ident() == self.thread:
            self.pending.append((self._events, Event(stamp=self.time, node=node, level=level, text=text)))

    # ---- the run

    def execute(self) -> Result:
        """Run to the end of the sources, a stop, or a failure; never raises for a node's mistakes."""
        try:
            self.warm()
            for name in self.graph.order:
                self._opened.append(name)
                self._guard(name, self.nodes[name].open)
            self._registry.hooks.hook.knotwork_run_started(run=self)
            self._dispatch_all()
        except KnotworkError as error:
            self._fail(error)
        statistics = self._end()
        code = self._failure.exit_code if self._failure is not None else int(self._errors > 0)
        return Result(code, statistics, self._failure, self._trace)

    def warm(self) -> None:
        """Build all nodes and compile their kernels; opens nothing."""
        self._configure()
        for name in self.graph.order:
            self._guard(name, self.nodes[name].warm)

    def stop_motion(self) -> None:
        """Stop everything that moves."""
        for node in self.nodes.values():
            self._quietly(node.stop_motion)

    def _configure(self) -> None:
        try:
            self.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot make the run's folder: {error.strerror}", where=str(self.out)) from error
        for name in self.graph.order:
            spec = self.pipeline.nodes[name]
            kind = spec.manifest.kind
            implementation = self._registry.load(spec.manifest)
            context = NodeContext(self, spec, monotonic_clocked() if kind == "sink" else self._clocked)
            self._contexts[name] = context
            for use in self.graph.uses:
                if use.node == name:
                    context.uses[use.name] = self.nodes[use.target]
            self.nodes[name] = self._guard(name, lambda i=implementation, c=context: i(c))
        self._wire()

    def _wire(self) -> None:
        outlets = {s: Outlet(s, str(s)) for s in self.graph.streams}
        for stream, outlet in outlets.items():
            context = self._contexts[stream.node]
            context.outlets[stream.port] = outlet
            spec = self.pipeline.nodes[stream.node]
            size, policy = self._queue(spec, "drop-oldest")
            context.channels[stream.port] = Channel(outlet.name, size, policy)
        for name, node in self.nodes.items():
            if isinstance(node, Sink):
                self._workers[name] = self._worker(name, node)
        for edge in self.graph.edges:
            outlet = outlets[edge.stream]
            worker = self._workers.get(edge.node)
            if worker is not None:
                if worker not in outlet.sinks:
                    outlet.sinks.append(worker)
                continue
            handler = getattr(self.nodes[edge.node], f"on_{edge.port.replace('-', '_')}", None)
            if handler is None:
                raise NodeError(edge.node, f"its class has no method on_{edge.port} for its input {edge.port!r}")
            outlet.handlers.append((edge.node, handler, self._histogram(edge.node)))
        for name, worker in self._workers.items():
            inputs = self.pipeline.nodes[name].manifest.inputs.values()
            for own in (self._events, self._statistics):
                if any(p.many and p.message in ("*", own.stream.message) for p in inputs):
                    own.sinks.append(worker)

    def _queue(self, spec: "NodeSpec", real: Any) -> tuple[int, Any]:
        policy = real if self.graph.clock == "real" else "block"
        if spec.queue is not None:
            return spec.queue.size, spec.queue.policy or policy
        return 10_000, policy

    def _worker(self, name: str, sink: Sink) -> SinkWorker:
        def failed(error: Exception, given_up: bool) -> None:
            text = str(error) if isinstance(error, KnotworkError) else f"{type(error).__name__}: {error}"
            self.report(name, "error", text)
            if given_up:
                self.report(name, "error", "given up after repeated failures; the run goes on without it")

        size, policy = self._queue(self.pipeline.nodes[name], "drop-oldest")
        clocked = self._contexts[name]._clocked
        return SinkWorker(sink, size, policy, clocked, self._histogram(name), failed)

    def _histogram(self, node: str) -> Histogram:
        return self._contexts[node].histograms.setdefault(node, Histogram())

    # ---- dispatching

    def _dispatch_all(self) -> None:
        for worker in self._workers.values():
            worker.start()
        self.timers.add(self._statistics_timer())
        drivers = [(n, d) for n, d in self.nodes.items() if isinstance(d, Driver)]
        pulled = [(n, d) for n, d in drivers if not self.pipeline.nodes[n].manifest.push]
        sources = [Source(n, d, self._clocked, self._histogram(n)) for n, d in pulled]
        self.progress = _progress([d for _, d in pulled])
        for source in sources:
            self._pull(source)
        pushing = [d for n, d in drivers if self.pipeline.nodes[n].manifest.push]
        for driver in pushing:
            driver.start()
        try:
            self._loop(sources, live=bool(pushing))
        finally:
            self.stop_motion()
            for driver in pushing:
                self._quietly(driver.stop)

    def _loop(self, sources: list[Source], live: bool) -> None:
        from knotwork.core.runtime.pace import Pace

        pace = Pace(self._rate, self._stop, self.inbox)
        while not self._stop.is_set():
            source = min((s for s in sources if s.item is not None), key=lambda s: s.time, default=None)
            if source is None and not live and not self.inbox:
                return
            event_time = None if source is None else max(source.time, self.time)
            due = self.timers.next_due() if pace.begun else None
            wait = pace.wait(event_time, due)
            if wait > 0 or self.inbox:
                entry = self.inbox.take(wait)
                if entry is not None and entry.message is not None:
                    self._begin(pace, max(self.time, entry.message.stamp))
                    context = self._contexts[entry.channel.name.partition(".")[0]]
                    outlet = context.outlets[entry.channel.name.partition(".")[2]]
                    self._event(outlet, entry.message)
                continue
            now = pace.now(event_time)
            self._fire(now if event_time is None else min(now, event_time))
            if source is None or event_time is None or event_time > now:
                continue
            self._begin(pace, event_time)
            item = source.item
            self.time = event_time
            if item is not None and not isinstance(item, int):
                outlet = self._contexts[source.node].outlets.get(item[0])
                if outlet is None:
                    raise NodeError(source.node, f"gave a message on {item[0]!r}, which its manifest does not declare")
                self._event(outlet, item[1])
            self._pull(source)

    def _begin(self, pace: Any, time: int) -> None:
        if not pace.begun:
            pace.begin(time)
            self.timers.begin(time)
            self._first_event = clock.monotonic()

    def _pull(self, source: Source) -> None:
        self._guard(source.node, source.advance)
        if self.pending:  # what the driver reported while it was pulled
            self._drain()

    def _event(self, outlet: Outlet, message: Message) -> None:
        self.time = max(self.time, message.stamp)
        self.pending.append((outlet, message))
        self._drain()

    def _fire(self, until: int) -> None:
        for at, timer in self.timers.due(until):
            self.time = max(self.time, at)
            self._guard(timer.node, lambda t=timer, a=at: t.call(a))
            self._drain()

    def _drain(self) -> None:
        """Handle everything that is pending, first in, first out, and all it gives rise to."""
        pending = self.pending
        clocked = self._clocked
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
                except KnotworkError as error:
                    raise self._blame(node, error) from error
                except Exception as error:
                    raise self._blame(node, error) from error
                finally:
                    clocked.stop(histogram)
            for tap in self._taps:
                tap(outlet.name, message)
            for worker in outlet.sinks:
                worker.put(outlet.name, message)

    # ---- ends and failures

    def _end(self) -> dict[str, Any]:
        """Finish what is open, whatever happened before."""
        self.inbox.close()
        for name in self.graph.order:
            if name in self._opened and name not in self._workers and not self._blamed(name):
                self._quietly(self.nodes[name].finish)
                self._quietly(self._drain)
        statistics = self.statistics()
        if self._opened:
            last = Statistics(stamp=self.time, data=statistics, final=True).sealed(self.time, self.seq)
            for worker in self._statistics.sinks:
                worker.put(self._statistics.name, last)
        for name, worker in self._workers.items():
            if name in self._opened and not worker.finish(_DRAIN_TIMEOUT):
                self.report(name, "error", f"did not finish within {_DRAIN_TIMEOUT:.0f} s; its last messages are lost")
        self._quietly(lambda: self._registry.hooks.hook.knotwork_run_finished(run=self, statistics=statistics))
        for name in reversed(self._opened):
            self._quietly(self.nodes[name].close)
        return self.statistics()

    def _guard(self, node: str, call: Callable[[], Any]) -> Any:
        """Call a node; whatever it raises becomes a NodeError with its name."""
        try:
            return call()
        except Exception as error:
            raise self._blame(node, error) from error

    def _blame(self, node: str, error: Exception) -> KnotworkError:
        if not self._trace:
            self._trace = traceback.format_exc()
        if isinstance(error, NodeError):
            return error
        if isinstance(error, KnotworkError):
            blamed = NodeError(node, str(error))
            blamed.exit_code = error.exit_code
            return blamed
        return NodeError(node, f"{type(error).__name__}: {error}", hint="the traceback is in run.log")

    def _blamed(self, node: str) -> bool:
        return isinstance(self._failure, NodeError) and self._failure.node == node

    def _fail(self, error: KnotworkError) -> None:
        if self._failure is None:
            self._failure = error
        else:
            self.report(getattr(error, "node", RUNTIME), "error", str(error))

    def _quietly(self, call: Callable[[], Any]) -> None:
        """Call on the way out: a second failure is reported, never hides the first."""
        try:
            call()
        except KnotworkError as error:
            self._fail(error)
        except Exception as error:  # noqa: BLE001 - everything else must still be closed
            self._fail(self._blame(RUNTIME, error))

    # ---- measurement

    def _statistics_timer(self) -> Any:
        from knotwork.core.runtime.sources import Timer

        def give(time: int) -> None:
            self.pending.append((self._statistics, Statistics(stamp=time, data=self.statistics())))

        return Timer(RUNTIME, round(_STATISTICS_EVERY * 1e9), give)

    def statistics(self) -> dict[str, Any]:
        """Return what was measured so far (see docs/architecture.md for the keys)."""
        nodes: dict[str, Any] = {}
        counters: dict[str, Any] = {}
        for name, context in self._contexts.items():
            for key, histogram in context.histograms.items():
                if histogram.n:
                    nodes[key] = histogram.summary()
            worker = self._workers.get(name)
            drops = sum(c.drops for c in context.channels.values()) + (worker.drops if worker else 0)
            nodes.setdefault(name, {"n": 0})["drops"] = drops
            own = dict(context.counters)
            if worker is not None:
                own |= {"backlog_max": worker.backlog_max, "failures": worker.failures}
            node = self.nodes.get(name)
            figures = node.statistics() if node is not None else {}
            counters[name] = own | figures
        now = clock.monotonic()
        return {
            "wall_s": (now - (self._first_event or now)) / 1e9,
            "startup_s": (max(self._first_event, self._begun) - self._begun) / 1e9,
            "clock": self.graph.clock,
            "stopped_by": self._stopped_by,
            "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            "nodes": nodes,
            "counters": {name: values for name, values in counters.items() if values},
        }


def _progress(drivers: list[Driver]) -> Callable[[], float | None]:
    def share() -> float | None:
        known = [p for p in (d.progress() for d in drivers) if p is not None]
        return min(known) if known else None

    return share
