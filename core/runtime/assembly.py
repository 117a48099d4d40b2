"""Builds the nodes of a pipeline and ties their ports together."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from knotwork.core.contracts import Node, Sink
from knotwork.core.errors import KnotworkError, NodeError
from knotwork.core.graph import Graph, Stream
from knotwork.core.registry import Registry
from knotwork.core.runtime.blame import guarded
from knotwork.core.runtime.context import NodeContext, Report
from knotwork.core.runtime.dispatcher import Dispatcher, Outlet
from knotwork.core.runtime.inbox import Channel, Policy
from knotwork.core.runtime.sink_worker import SinkWorker, monotonic_clocked

if TYPE_CHECKING:
    from knotwork.core.config import NodeSpec, Pipeline

_QUEUE_SIZE = 10_000  # messages


@dataclass(frozen=True, slots=True)
class Assembly:
    """A pipeline's nodes, ready to run."""

    nodes: dict[str, Node]  # in the graph's order
    contexts: dict[str, NodeContext]
    workers: dict[str, SinkWorker]

    def outlet(self, node: str, port: str) -> Outlet:
        """Return a node's stream."""
        return self.contexts[node].outlet(port)


def assemble(
    pipeline: "Pipeline",
    graph: Graph,
    registry: Registry,
    dispatcher: Dispatcher,
    report: Report,
    own: list[Outlet],
    *,
    out: Path,
    header: dict[str, Any],
) -> Assembly:
    """Import, build and wire all nodes; `own` are the runtime's streams, which sinks may take.

    Raises
    ------
    KnotworkError
        A plugin cannot be imported, or its node cannot be built.
    """
    nodes: dict[str, Node] = {}
    contexts: dict[str, NodeContext] = {}
    for name in graph.order:
        spec = pipeline.nodes[name]
        implementation: Any = registry.load(spec.manifest)
        clocked = monotonic_clocked() if spec.manifest.kind == "sink" else dispatcher.clocked
        playback = None if graph.clock == "real" else dispatcher.pace
        context = NodeContext(
            spec, dispatcher, clocked, report, out=out, seed=pipeline.seed, header=header, playback=playback
        )
        context.uses |= {u.name: nodes[u.target] for u in graph.uses if u.node == name}
        contexts[name] = context
        nodes[name] = guarded(name, partial(implementation, context))
    workers = {n: _worker(pipeline.nodes[n], s, graph, report) for n, s in nodes.items() if isinstance(s, Sink)}
    _wire(pipeline, graph, nodes, contexts, workers)
    for outlet in own:
        outlet.sinks.extend(w for n, w in workers.items() if _takes(pipeline.nodes[n], outlet.stream))
    return Assembly(nodes, contexts, workers)


def _wire(
    pipeline: "Pipeline",
    graph: Graph,
    nodes: dict[str, Node],
    contexts: dict[str, NodeContext],
    workers: dict[str, SinkWorker],
) -> None:
    outlets: dict[Stream, Outlet] = {}
    for stream in graph.streams:
        channel = Channel(*_queue(pipeline.nodes[stream.node], graph))
        outlets[stream] = contexts[stream.node].outlets[stream.port] = Outlet(stream, str(stream), channel)
    # A used node hears of a message before its user does: a prior takes a scan before the localiser asks it.
    for edge in sorted(graph.edges, key=lambda e: graph.order.index(e.node)):
        outlet = outlets[edge.stream]
        worker = workers.get(edge.node)
        if worker is None:
            handler = getattr(nodes[edge.node], f"on_{edge.port.replace('-', '_')}", None)
            if handler is None:
                raise NodeError(edge.node, f"its class has no method on_{edge.port} for its input {edge.port!r}")
            outlet.handlers.append((edge.node, handler, contexts[edge.node].histogram()))
        elif worker not in outlet.sinks:
            outlet.sinks.append(worker)


def _takes(spec: "NodeSpec", stream: Stream) -> bool:
    return any(p.many and p.message in ("*", stream.message) for p in spec.manifest.inputs.values())


def _queue(spec: "NodeSpec", graph: Graph) -> tuple[int, Policy]:
    policy: Policy = "drop-oldest" if graph.clock == "real" else "block"
    if spec.queue is None:
        return _QUEUE_SIZE, policy
    return spec.queue.size, spec.queue.policy or policy


def _worker(spec: "NodeSpec", sink: Sink, graph: Graph, report: Report) -> SinkWorker:
    def failed(error: Exception, given_up: bool) -> None:
        report(
            spec.name, "error", str(error) if isinstance(error, KnotworkError) else f"{type(error).__name__}: {error}"
        )
        if given_up:
            report(spec.name, "error", "given up after repeated failures; the run goes on without it")

    size, policy = _queue(spec, graph)

    def dropping() -> None:
        text = f"takes less than the run gives: its queue ({size} messages) is full, the oldest are dropped and counted"
        report(spec.name, "error", text)

    context = sink.context
    assert isinstance(context, NodeContext)
    return SinkWorker(sink, size, policy, context.clocked, context.histogram(), failed, dropping)
