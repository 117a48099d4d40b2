"""A part of a log, or several logs in one: whole, indexed files again."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from heapq import merge as merge_sorted
from pathlib import Path
from typing import Any

import msgspec

from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.log.reader import RUN, Log, LogChannel
from knotwork.core.log.records import RawMessage
from knotwork.core.log.writer import McapWriter, sync


@dataclass(slots=True)
class Edited:
    """What was written, and what the sources could not give."""

    path: Path
    messages: int = 0
    lost: list[str] = field(default_factory=list)


def cut(
    path: Path,
    output: Path,
    *,
    start: float = 0.0,
    stop: float | None = None,
    wanted: Callable[[LogChannel], bool] = lambda channel: True,
) -> Edited:
    """Write the part of a log between two times [s after its first message], and of it the channels `wanted`.

    Raises
    ------
    InputError
        The log cannot be read, or the output is the log itself.
    KnotworkError
        The output cannot be written.
    """
    log = Log(path)
    log.overview()
    first = min((channel.first for channel in log.channels.values() if channel.count), default=0)
    begin = first + round(start * 1e9)
    end = None if stop is None else first + round(stop * 1e9)
    run = dict(log.run)
    if run:
        run["cut"] = [start, stop]
    chosen = ((channel, message) for channel, message in log.raw(begin, end) if wanted(channel))
    return _write([log], chosen, run, output)


def merge(paths: list[Path], output: Path) -> Edited:
    """Write several logs as one, by log time; equal times in the order of the files.

    Channels that are alike in everything become one, so that the parts of a split run are one log again.

    Raises
    ------
    InputError
        A log cannot be read, or the output is one of them.
    KnotworkError
        The output cannot be written.
    """
    logs = [Log(path) for path in paths]
    for log in logs:
        log.overview()
    run = next((dict(log.run) for log in logs if log.run), {})
    if run:
        parts = [log.run.get("part") for log in logs]
        if parts == list(range(len(logs))):
            del run["part"]  # a split run, whole again
        else:
            run["merged"] = [path.name for path in paths]
    return _write(logs, merge_sorted(*(log.raw() for log in logs), key=lambda pair: pair[1].log_time), run, output)


def _write(
    logs: list[Log], messages: Iterable[tuple[LogChannel, RawMessage]], run: dict[str, Any], output: Path
) -> Edited:
    for log in logs:
        if output.exists() and output.samefile(log.path):
            raise InputError("the output must be another file than the log", where=str(output))
    partial = output.with_name(output.name + ".partial")
    try:
        try:
            with partial.open("wb", buffering=0) as file:
                writer = McapWriter(file)
                if run:
                    writer.add_metadata(RUN, {key: msgspec.json.encode(value).decode() for key, value in run.items()})
                _copy(messages, writer)
                writer.finish()
                sync(file)
            partial.replace(output)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise KnotworkError(f"cannot write: {error.strerror}", where=str(output)) from error
    return Edited(output, writer.messages, list(_lost(logs)))


def _lost(logs: list[Log]) -> Iterator[str]:
    for log in logs:
        for note in log.damage.notes:
            yield f"{log.path}: {note}"
        for reason, n in log.unreadable.items():
            yield f"{log.path}: {n} messages: {reason}"


def _copy(messages: Iterable[tuple[LogChannel, RawMessage]], writer: McapWriter) -> None:
    schemas: dict[tuple[str, str, bytes], int] = {}
    alike: dict[Any, int] = {}
    numbers: dict[int, int] = {}  # by the channel's identity: a quick look before the thorough one
    kept: list[LogChannel] = []  # keeps these identities from being given again
    for channel, message in messages:
        number = numbers.get(id(channel))
        if number is None:
            schema = (channel.schema, channel.schema_encoding, channel.definition)
            if channel.schema and schema not in schemas:
                schemas[schema] = writer.register_schema(*schema)
            key = (channel.topic, channel.encoding, schema, tuple(sorted(channel.metadata.items())))
            if key not in alike:
                alike[key] = writer.register_channel(
                    channel.topic, channel.encoding, schemas.get(schema, 0), channel.metadata
                )
            number = numbers[id(channel)] = alike[key]
            kept.append(channel)
        writer.add(number, message.log_time, message.publish_time, message.sequence, message.data)
