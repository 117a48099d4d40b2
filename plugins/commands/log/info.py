"""Show what is in a log: its channels, times, the run that made it, its state."""

import sys
from pathlib import Path
from typing import Any

import msgspec

from knotwork.core.log.reader import Log, LogChannel

_SECOND = 1_000_000_000


def arguments(parser: Any) -> None:
    """Add the arguments."""
    parser.add_argument("file", type=Path, metavar="FILE", help="the log")
    parser.add_argument("--config", action="store_true", help="also show the configuration of the run")
    parser.add_argument("--json", action="store_true", help="everything as JSON")


def run(arguments: Any) -> int:
    """Read the log and show it."""
    log = Log(arguments.file)
    log.overview()
    facts = describe(log)
    if arguments.json:
        text = msgspec.json.format(msgspec.json.encode(facts, enc_hook=str), indent=2).decode()
    else:
        text = _text(facts, arguments.config)
    sys.stdout.write(text + "\n")
    return 0


def describe(log: Log) -> dict[str, Any]:
    """Return the facts about a scanned log; times in ns, durations in s."""
    channels = [channel for channel in log.channels.values() if channel.count]
    start = min((channel.first for channel in channels), default=0)
    end = max((channel.last for channel in channels), default=0)
    damage = log.damage
    return {
        "path": str(log.path),
        "bytes": log.path.stat().st_size,
        "library": log.library,
        "complete": damage.complete,
        "damaged_chunks": damage.damaged_chunks,
        "lost_bytes": damage.lost_bytes,
        "start_ns": start,
        "end_ns": end,
        "duration_s": (end - start) / _SECOND,
        "messages": sum(channel.count for channel in channels),
        "channels": [_channel(channel) for channel in sorted(channels, key=lambda channel: channel.topic)],
        "run": log.run,
    }


def _channel(channel: LogChannel) -> dict[str, Any]:
    span = (channel.last - channel.first) / _SECOND
    return {
        "topic": channel.topic,
        "schema": channel.schema,
        "encoding": channel.encoding,
        "stream": channel.stream,
        "type": channel.type,
        "role": channel.metadata.get("role", ""),
        "wall_clock": channel.wall_clock,
        "count": channel.count,
        "first_ns": channel.first,
        "last_ns": channel.last,
        "rate_hz": (channel.count - 1) / span if span else None,
    }


def _text(facts: dict[str, Any], with_config: bool) -> str:
    state = "complete" if facts["complete"] else f"cut short (knotwork log recover {facts['path']})"
    if facts["damaged_chunks"]:
        state += f", {facts['damaged_chunks']} damaged chunks"
    lines = [
        f"{facts['path']}: {facts['bytes'] / 1e6:.2f} MB, {state}",
        f"{facts['messages']} messages in {facts['duration_s']:.3f} s, "
        f"from {facts['start_ns'] / _SECOND:.3f} to {facts['end_ns'] / _SECOND:.3f}, "
        f"written by {facts['library']}",
    ]
    run = {key: value for key, value in facts["run"].items() if with_config or key != "config"}
    lines += [f"{key}: {msgspec.json.encode(value, enc_hook=str).decode()}" for key, value in sorted(run.items())]
    rows = [("topic", "schema", "messages", "rate")]
    for channel in facts["channels"]:
        rate = "" if channel["rate_hz"] is None else f"{channel['rate_hz']:.2f} Hz"
        rows.append((channel["topic"], channel["schema"], str(channel["count"]), rate))
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    for topic, schema, count, rate in rows:
        left = f"{topic:<{widths[0]}}  {schema:<{widths[1]}}"
        lines.append(f"{left}  {count:>{widths[2]}}  {rate:>{widths[3]}}".rstrip())
    return "\n".join(lines)
