"""The pipeline a log was made by, its drivers replaced by the log itself."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from knotwork.core.errors import InputError
from knotwork.core.log.reader import Log
from knotwork.core.playback.recording import parts
from knotwork.core.registry import Registry


@dataclass(frozen=True, slots=True)
class Stored:
    """What a log says of the run that wrote it.

    Attributes
    ----------
    path, logs
        The file, or the pattern of the parts of one run, and these parts, looked at.
    cut
        Which part of the run the log is, as `knotwork log cut` has written; empty for all.
    config
        The resolved pipeline, as plain data.
    kinds
        Kind of each node's plugin; "" for a plugin that is not installed.
    external
        Nodes whose messages came from outside: a replay takes them from the log.
    streams
        The log's streams (`node.port`) and how many messages each has.
    """

    path: Path
    logs: list[Log]
    cut: list[float | None]
    config: dict[str, Any]
    kinds: dict[str, str]
    external: frozenset[str]
    streams: dict[str, int]


def stored(path: Path, registry: Registry) -> Stored:
    """Read what a log says of its run.

    Raises
    ------
    InputError
        It cannot be read, or does not say which pipeline wrote it.
    """
    logs = [Log(part) for part in parts(str(path))]
    for log in logs:
        log.overview()
    about = logs[0].run
    text = about.get("config")
    try:
        config = yaml.safe_load(text) if isinstance(text, str) else None
    except yaml.YAMLError:
        config = None
    if not isinstance(config, dict) or not isinstance(config.get("nodes"), dict):
        raise InputError(
            "does not say which pipeline wrote it",
            where=str(path),
            hint="name one that reads it: {plugin: mcap-log, path: ...}",
        )
    manifests = {name: registry.find(str(node.get("plugin"))) for name, node in config["nodes"].items()}
    told = about.get("external")
    if not isinstance(told, list):
        told = [name for name, manifest in manifests.items() if manifest is not None and manifest.external]
    streams: dict[str, int] = {}
    for log in logs:
        for channel in log.channels.values():
            if channel.stream and channel.count:
                streams[channel.stream] = streams.get(channel.stream, 0) + channel.count
    return Stored(
        path,
        logs,
        about.get("cut") or [],
        config,
        {name: manifest.kind if manifest is not None else "" for name, manifest in manifests.items()},
        frozenset(told),
        streams,
    )


def as_replay(run: Stored, *, sinks: bool, start: float = 0.0, stop: float | None = None) -> dict[str, Any]:
    """Return the pipeline fed from the log, as plain data.

    Parameters
    ----------
    sinks
        Keep its sinks.
    start, stop
        Part of the log [s].

    Raises
    ------
    InputError
        The log has no message of any source.
    """
    nodes: dict[str, Any] = {}
    for name, node in run.config["nodes"].items():
        kind = run.kinds.get(name, "")
        if name in run.external and not (sinks and kind == "sink"):
            own = {s.partition(".")[2]: s for s in run.streams if s.partition(".")[0] == name}
            if own:
                nodes[name] = {"plugin": "mcap-log", "path": str(run.path).replace("${", "$${"), "streams": own}
                nodes[name] |= {"start": start} | ({} if stop is None else {"stop": stop})
        elif sinks or kind != "sink":
            nodes[name] = dict(node)
    if not any(node["plugin"] == "mcap-log" for node in nodes.values()):
        raise InputError("the log has no message of its run's sources", where=str(run.path))
    for node in nodes.values():
        _unwire(node, run, nodes)
    return {**run.config, "clock": "auto", "nodes": nodes}


def _unwire(node: dict[str, Any], run: Stored, nodes: dict[str, Any]) -> None:
    """Take out wires to what is not there any more."""
    if "inputs" in node:
        inputs = {port: [one] if isinstance(one, str) else one for port, one in node["inputs"].items()}
        left = {port: [text for text in given if _there(text, run, nodes)] for port, given in inputs.items()}
        node["inputs"] = {port: given for port, given in left.items() if given or not inputs[port]}
    if "uses" in node:
        node["uses"] = {use: target for use, target in node["uses"].items() if target not in run.external}


def _there(text: str, run: Stored, nodes: dict[str, Any]) -> bool:
    name, _, port = text.partition(".")
    if name not in nodes:
        return False
    return nodes[name]["plugin"] != "mcap-log" or not port or text in run.streams
