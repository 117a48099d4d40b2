"""Wires the nodes of a pipeline: streams (typed messages) and uses (queryable state).

An edge is inferred when exactly one producer fits a port by message type and role; otherwise the YAML
writes it (`inputs: {scan: front.scan}`). Cycles are legal only through a driver or a feedback port.
"""

import difflib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from knotwork.core.errors import ConfigError, Problem
from knotwork.core.manifest import Port

if TYPE_CHECKING:
    from knotwork.core.config import NodeSpec, Pipeline


@dataclass(frozen=True, slots=True)
class Stream:
    """An output port of a node: where messages of one type and role come from."""

    node: str
    port: str
    message: str
    role: str

    def __str__(self) -> str:
        """Render as `node.port`."""
        return f"{self.node}.{self.port}"

    @property
    def what(self) -> str:
        """Render as `pose (estimate)`."""
        return f"{self.message} ({self.role})" if self.role else self.message


@dataclass(frozen=True, slots=True)
class Edge:
    """A stream that arrives at an input port."""

    stream: Stream
    node: str
    port: str
    feedback: bool


@dataclass(frozen=True, slots=True)
class UseEdge:
    """A node that queries another node's state."""

    node: str
    name: str
    protocol: str
    target: str


@dataclass(frozen=True, slots=True)
class Graph:
    """A wired pipeline.

    Attributes
    ----------
    order
        Node names such that a used node comes before its user; else as in the YAML.
    cycles
        The legal cycles, as node names.
    clock
        "replay", "sim" or "real".
    """

    streams: tuple[Stream, ...]
    edges: tuple[Edge, ...]
    uses: tuple[UseEdge, ...]
    order: tuple[str, ...]
    cycles: tuple[tuple[str, ...], ...]
    clock: str

    @property
    def finish_order(self) -> tuple[str, ...]:
        """Node names such that a used node comes after all its users, whose last work it is to have."""
        found: list[str] = []

        def visit(name: str) -> None:
            if name not in found:
                for use in self.uses:
                    if use.target == name:
                        visit(use.node)
                found.append(name)

        for name in self.order:
            visit(name)
        return tuple(found)


def build(pipeline: "Pipeline") -> Graph:
    """Wire a pipeline.

    Raises
    ------
    ConfigError
        Every missing, ambiguous or ill-typed wire, with its place in the YAML.
    """
    problems: list[Problem] = []
    streams = tuple(
        Stream(name, port, out.message, out.role)
        for name, node in pipeline.nodes.items()
        for port, out in node.manifest.outputs.items()
    )
    edges: list[Edge] = []
    uses: list[UseEdge] = []
    for node in pipeline.nodes.values():
        for port_name, port in node.manifest.inputs.items():
            wires = _wires(pipeline, node, port_name, port, streams, problems)
            edges.extend(Edge(stream, node.name, port_name, port.feedback) for stream in wires)
        uses.extend(_uses(pipeline, node, problems))
    clock = _clock(pipeline, problems)
    order = _order(pipeline, uses, problems)
    cycles = _cycles(pipeline, edges, uses, problems)
    if problems:
        raise ConfigError(problems)
    return Graph(streams, tuple(edges), tuple(uses), order, cycles, clock)


def _fits(stream: Stream, port: Port) -> bool:
    return port.message in ("*", stream.message) and port.role in ("", stream.role)


def _wires(
    pipeline: "Pipeline",
    node: "NodeSpec",
    name: str,
    port: Port,
    streams: Iterable[Stream],
    problems: list[Problem],
) -> list[Stream]:
    path = f"nodes.{node.name}.inputs.{name}"
    fitting = [s for s in streams if s.node != node.name and _fits(s, port)]
    wanted = Stream("", "", port.message, port.role).what
    if name in node.inputs:
        return _written(pipeline, node, path, name, port, streams, problems)
    if port.many or len(fitting) == 1:
        return fitting
    here = pipeline.where(f"nodes.{node.name}")
    if fitting:
        listed = ", ".join(map(str, fitting))
        problems.append(
            Problem(
                here, f"nodes.{node.name}", f"input {name!r} takes one {wanted}, and {listed} all give one",
                f"write inputs: {{{name}: {fitting[0]}}}",
            )
        )  # fmt: skip
    elif not port.optional:
        others = sorted({s.what for s in streams if s.node != node.name and s.message == port.message})
        hint = f"there is only {', '.join(others)}" if others else f"add a node that gives {wanted}"
        problems.append(
            Problem(here, f"nodes.{node.name}", f"input {name!r} needs a {wanted}, and no node gives one", hint)
        )
    return []


def _written(
    pipeline: "Pipeline",
    node: "NodeSpec",
    path: str,
    name: str,
    port: Port,
    streams: Iterable[Stream],
    problems: list[Problem],
) -> list[Stream]:
    """Return the wires that the YAML writes for a port, each once."""
    written = dict.fromkeys(node.inputs[name])
    wires: list[Stream] = []
    for text in written:
        wires.extend(s for s in _explicit(pipeline, path, text, port, streams, problems) if s not in wires)
    wanted = Stream("", "", port.message, port.role).what
    if len(wires) > 1 and not port.many:
        listed = ", ".join(map(str, wires))
        problems.append(Problem(pipeline.where(path), path, f"input {name!r} takes one {wanted}, got {listed}"))
    if not written and not port.optional and not port.many:
        problems.append(Problem(pipeline.where(path), path, f"input {name!r} needs a {wanted}: the list is empty"))
    return wires


def _explicit(
    pipeline: "Pipeline",
    path: str,
    text: str,
    port: Port,
    streams: Iterable[Stream],
    problems: list[Problem],
) -> list[Stream]:
    where = pipeline.where(path)
    named = [s for s in streams if str(s) == text or (s.node == text and _fits(s, port))]
    if len(named) == 1 and _fits(named[0], port):
        return named
    wanted = Stream("", "", port.message, port.role).what
    if len(named) == 1:
        problems.append(Problem(where, path, f"{text} gives {named[0].what}, expected {wanted}"))
    elif named:
        problems.append(Problem(where, path, f"{text!r} is ambiguous: {', '.join(map(str, named))}"))
    else:
        close = difflib.get_close_matches(text, [str(s) for s in streams], n=1)
        hint = f"did you mean {close[0]!r}?" if close else "expected node.port"
        problems.append(Problem(where, path, f"no stream {text!r}", hint))
    return []


def _uses(pipeline: "Pipeline", node: "NodeSpec", problems: list[Problem]) -> Iterator[UseEdge]:
    for name, use in node.manifest.uses.items():
        path = f"nodes.{node.name}.uses.{name}"
        offering = [n.name for n in pipeline.nodes.values() if use.protocol in n.manifest.provides and n is not node]
        chosen = node.uses.get(name)
        here = pipeline.where(f"nodes.{node.name}")
        if chosen is not None:
            if chosen in offering:
                yield UseEdge(node.name, name, use.protocol, chosen)
            else:
                hint = f"these do: {', '.join(offering)}" if offering else ""
                problems.append(
                    Problem(pipeline.where(path), path, f"{chosen!r} does not provide a {use.protocol}", hint)
                )
        elif len(offering) == 1:
            yield UseEdge(node.name, name, use.protocol, offering[0])
        elif offering:
            message = f"use {name!r} takes one {use.protocol}, and {', '.join(offering)} all provide one"
            problems.append(Problem(here, f"nodes.{node.name}", message, f"write uses: {{{name}: {offering[0]}}}"))
        elif not use.optional:
            message = f"use {name!r} needs a node that provides a {use.protocol}, and none does"
            problems.append(Problem(here, f"nodes.{node.name}", message, f"add a {use.protocol} to the pipeline"))


def _clock(pipeline: "Pipeline", problems: list[Problem]) -> str:
    drivers = [n for n in pipeline.nodes.values() if n.manifest.kind == "driver"]
    if not drivers:
        problems.append(
            Problem(
                pipeline.where("nodes"),
                "nodes",
                "no driver: nothing would ever happen",
                "add a log or a device",
            )
        )
    natural = "replay"
    if any(n.manifest.closed_loop for n in drivers):
        natural = "sim"
    if any(n.manifest.push for n in drivers):
        natural = "real"
    if pipeline.clock == "auto":
        return natural
    if pipeline.clock != "real" and natural == "real":
        pushing = ", ".join(n.name for n in drivers if n.manifest.push)
        message = f"clock {pipeline.clock} cannot pull {pushing}: a device gives data when it likes"
        problems.append(Problem(pipeline.where("clock"), "clock", message, "use clock: real or a log driver"))
    return pipeline.clock


def _order(pipeline: "Pipeline", uses: list[UseEdge], problems: list[Problem]) -> tuple[str, ...]:
    order: list[str] = []
    open_nodes: list[str] = []

    def visit(name: str) -> None:
        if name in order:
            return
        if name in open_nodes:
            chain = " -> ".join([*open_nodes[open_nodes.index(name) :], name])
            problems.append(Problem(pipeline.where(f"nodes.{name}"), f"nodes.{name}", f"uses go in a circle: {chain}"))
            return
        open_nodes.append(name)
        for use in uses:
            if use.node == name:
                visit(use.target)
        open_nodes.pop()
        order.append(name)

    for name in pipeline.nodes:
        visit(name)
    return tuple(order)


def _cycles(
    pipeline: "Pipeline", edges: list[Edge], uses: list[UseEdge], problems: list[Problem]
) -> tuple[tuple[str, ...], ...]:
    """Find cycles; one that survives without the edges that may close a cycle is a problem."""
    drivers = {n.name for n in pipeline.nodes.values() if n.manifest.kind == "driver"}
    flows = [(e.stream.node, e.node, e.feedback or e.node in drivers) for e in edges]
    flows += [(u.target, u.node, False) for u in uses]
    used = {(u.target, u.node) for u in uses}
    for cycle in _circles((a, b) for a, b, legal in flows if not legal):
        if all(pair in used for pair in zip(cycle, (*cycle[1:], cycle[0]), strict=True)):
            continue  # `_order` has said so
        chain = " -> ".join([*cycle, cycle[0]])
        message = f"streams go in a circle: {chain}"
        hint = "a cycle is legal only through a driver or a feedback port"
        problems.append(Problem(pipeline.where(f"nodes.{cycle[0]}"), f"nodes.{cycle[0]}", message, hint))
    return tuple(_circles((a, b) for a, b, _ in flows))


def _circles(flows: Iterable[tuple[str, str]]) -> list[tuple[str, ...]]:
    """List one cycle for each edge that closes one in a depth-first walk."""
    after: dict[str, list[str]] = {}
    for a, b in flows:
        if b not in after.setdefault(a, []):
            after[a].append(b)
    found: list[tuple[str, ...]] = []
    done: set[str] = set()

    def visit(name: str, path: list[str]) -> None:
        if name in path:
            found.append(tuple(path[path.index(name) :]))
            return
        if name in done:
            return
        for follower in after.get(name, ()):
            visit(follower, [*path, name])
        done.add(name)

    for name in list(after):
        visit(name, [])
    return found


def text(graph: Graph, pipeline: "Pipeline") -> str:
    """Render the graph as lines for a terminal."""
    lines = [f"pipeline {pipeline.name} (clock: {graph.clock})"]
    for name, node in pipeline.nodes.items():
        lines.append(f"  {name}: {node.plugin} [{node.manifest.kind}]")
        lines += [f"    <- {e.stream}  {e.stream.what}{_mark(e)}" for e in graph.edges if e.node == name]
        lines += [f"    uses {u.target} ({u.protocol})" for u in graph.uses if u.node == name]
        lines += [f"    -> {s.port}  {s.what}" for s in graph.streams if s.node == name]
    lines += ["cycle: " + " -> ".join([*cycle, cycle[0]]) for cycle in graph.cycles]
    return "\n".join(lines)


def _mark(edge: Edge) -> str:
    return "  (feedback)" if edge.feedback else ""


def mermaid(graph: Graph, pipeline: "Pipeline") -> str:
    """Render the graph as a Mermaid flowchart."""
    lines = ["flowchart LR"]
    lines += [f'  {_identifier(name)}["{name}<br/>{node.plugin}"]' for name, node in pipeline.nodes.items()]
    for e in graph.edges:
        arrow = "-.->" if e.feedback else "-->"
        lines.append(f'  {_identifier(e.stream.node)} {arrow}|"{e.stream.what}"| {_identifier(e.node)}')
    lines += [f'  {_identifier(u.node)} ===|"uses {u.protocol}"| {_identifier(u.target)}' for u in graph.uses]
    return "\n".join(lines)


def _identifier(name: str) -> str:
    # Injective, so that `a-b` and `a_b` stay two nodes.
    return "n_" + "".join(c if c.isascii() and c.isalnum() else f"_{ord(c):x}_" for c in name)
