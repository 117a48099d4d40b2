"""Saved maps in formats that others read; any map, by the plugin that saved it."""

from pathlib import Path
from typing import Any

from knotwork.core.bare_context import BareContext
from knotwork.core.contracts import Level, Map, Node, Sink
from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.files import write_atomic
from knotwork.core.map_file import describe_map
from knotwork.core.messages import Grid
from knotwork.core.registry import Registry
from knotwork.plugins.commands.map.svg import svg

FORMATS = ("pgm", "png", "svg")
_SINKS = {"pgm": ("map-export", {}), "png": ("map-image", {"trajectory": False})}


class _Context(BareContext):
    """A map or sink for one file: what goes wrong ends the command."""

    def report(self, level: Level, text: str) -> None:
        if level == "error":
            raise KnotworkError(text)


def open_map(file: Path, registry: Registry | None = None) -> Map:
    """Return the map of a file, in a node of the plugin that saved it.

    Raises
    ------
    InputError
        Missing, damaged, no map, or its plugin is not installed.
    """
    registry = registry or Registry()
    kind, _, facts = describe_map(file)
    config = dict(facts.get("config") or {"resolution": facts.get("resolution")})
    node = _node(registry, kind, config | {"load": "", "save": ""}, facts.get("options") or {}, Path(), str(file))
    if not isinstance(node, Map):
        raise InputError(f"was saved by {kind!r}, which is no map here", where=str(file))
    node.load(file)
    return node


def convert(file: Path, to: str, output: Path, resolution: float | None = None) -> list[Path]:
    """Write the map of `file` to `output` as one of `FORMATS`; return the files written.

    Raises
    ------
    InputError
        As `open_map`; or the map knows nothing, or has no outlines.
    """
    registry = Registry()
    chart = open_map(file, registry)
    if to == "svg":
        outlines = chart.outlines()
        if outlines is None:
            raise InputError("a map of this kind has no outlines", where=str(file), hint="--to png, or pgm")
        output = output.with_suffix(".svg")
        write_atomic(output, svg(outlines).encode())
        return [output]
    cells, side, origin = chart.rasterize(resolution)
    if not cells.size:
        raise InputError("the map is empty", where=str(file))
    output = output.absolute()
    sink_name, keys = _SINKS[to]
    sink = _node(registry, sink_name, {"name": output.stem, **keys}, {}, output.parent, "--output")
    assert isinstance(sink, Sink)
    sink.on_message(
        "map.grid", Grid(stamp=0, cells=cells, resolution=side, origin=origin, map_bytes=chart.nbytes, final=True)
    )
    sink.close()
    written = [output.with_suffix(f".{to}")]
    return [*written, output.with_suffix(".yaml")] if to == "pgm" else written


def _node(
    registry: Registry, plugin: str, config: dict[str, Any], options: dict[str, Any], out: Path, where: str
) -> Node:
    manifest = registry.find(plugin)
    if manifest is None:
        cause = registry.why_not(plugin) or "it is not installed"
        raise InputError(f"needs the plugin {plugin!r}: {cause}", where=where)
    try:
        model = manifest.config.model_validate(config)
        chosen = manifest.options.model_validate(options) if manifest.options else None
    except ValueError as error:  # pydantic's: the file is of another version, or the name is no file name
        first = str(error).splitlines()[1:3]
        raise InputError(f"does not fit the plugin {plugin!r}: {' '.join(first)}", where=where) from error
    node: Node = registry.load(manifest)(_Context(plugin, model, chosen, out=out))
    return node
