"""A log as messages: which streams it has, who made it, and every message in the order of the run."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Channel, Header, Metadata, Schema

from knotwork.core import codec
from knotwork.core.errors import InputError
from knotwork.core.log.records import Damage, RawMessage, chunk_records, records
from knotwork.core.log.summary import Summary, summary
from knotwork.core.message_types import message_class
from knotwork.core.messages import Message

PREFIX = "/knotwork/"  # topics of the lossless channels: /knotwork/<node>/<port>
ENCODING = "msgpack"
SCHEMA_PREFIX = "knotwork."  # schema names of the lossless channels: knotwork.<type>
RUN = "knotwork.run"  # name of the metadata record about the run


@dataclass(slots=True)
class LogChannel:
    """One channel of a log and what was read of it.

    Attributes
    ----------
    schema_encoding, definition
        The schema itself and what it is written in.
    stream, type
        `node.port` and message type of a lossless channel; "" for a view or a foreign channel.
    wall_clock
        Its content comes from the wall clock and differs between identical runs.
    count, first, last
        Messages read so far, and the log times [ns] of the first and last.
    """

    topic: str
    encoding: str
    schema: str
    metadata: dict[str, str]
    schema_encoding: str = ""
    definition: bytes = b""
    stream: str = ""
    type: str = ""
    wall_clock: bool = False
    count: int = 0
    first: int = 0
    last: int = 0

    def saw(self, time: int) -> None:
        """Count a message."""
        if not self.count:
            self.first = time
        self.count += 1
        self.last = max(self.last, time)


class Log:
    """One pass after another over an MCAP file; finished, cut short or damaged.

    Parameters
    ----------
    path
        The file.

    Attributes
    ----------
    damage
        What the last pass found wrong.
    channels
        What the last pass met, by id.
    run
        What the recorder wrote about the run (resolved config, versions, seed, ...); from the last pass.
    unreadable
        Messages the last pass had to leave out, by what was the matter with them.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._begin()

    def _begin(self) -> None:
        self.damage = Damage()
        self.channels: dict[int, LogChannel] = {}
        self.run: dict[str, Any] = {}
        self.library = ""
        self.unreadable: dict[str, int] = {}

    def overview(self) -> None:
        """Read channels, counts and times from the end of a finished file; of any other file, `scan`.

        Raises
        ------
        InputError
            The file cannot be opened or is not MCAP.
        """
        found = summary(self.path)
        if found is None or found.statistics is None:
            self.scan()
            return
        self._begin()
        self._take(found)
        self.damage.complete = True
        counts = found.statistics.channel_message_counts
        for number, channel in self.channels.items():
            channel.count = counts.get(number, 0)
            channel.first, channel.last = found.spans.get(
                number, (found.statistics.message_start_time, found.statistics.message_end_time)
            )

    def scan(self) -> None:
        """Read the whole file for its channels, counts, times and damage.

        Raises
        ------
        InputError
            The file cannot be opened or is not MCAP.
        """
        for channel, message in self.file_order():
            channel.saw(message.log_time)

    def messages(
        self,
        *,
        streams: Collection[str] | None = None,
        types: Collection[str] | None = None,
        wall_clock: bool = True,
    ) -> Iterator[tuple[str, Message]]:
        """Yield `(stream, message)` in the order they were dispatched.

        Parameters
        ----------
        streams, types
            Only these streams (`node.port`) or message types; None for all.
        wall_clock
            False leaves out the channels that differ between identical runs.

        Raises
        ------
        InputError
            The file cannot be opened or is not MCAP. A message that cannot be decoded, or whose type no
            installed plugin knows, is left out and counted in `unreadable`.
        """
        classes: dict[str, type[Message] | None] = {}
        for channel, raw in self.file_order():
            name = channel.type
            if (
                not name
                or (streams is not None and channel.stream not in streams)
                or (types is not None and name not in types)
                or (channel.wall_clock and not wall_clock)
            ):
                continue
            channel.saw(raw.log_time)
            try:
                if name not in classes:
                    classes[name] = None
                    classes[name] = message_class(name)
                cls = classes[name]
                if cls is not None:
                    message = codec.decode(cls, raw.data)
                else:
                    raise InputError(f"unknown message type `{name}`")
            except InputError as error:
                self._leave_out(error.message)
            else:
                yield channel.stream, message

    def raw(self, start: int = 0, stop: int | None = None) -> Iterator[tuple[LogChannel, RawMessage]]:
        """Yield channels and undecoded messages in order of log time, those logged alike in the file's order.

        The chunks outside [start, stop] [ns] of a finished file are not touched; a file without an index
        is read from its beginning, in its own order.

        Raises
        ------
        InputError
            The file cannot be opened or is not MCAP.
        """
        found = summary(self.path)
        if found is None or not found.chunks:
            for channel, message in self.file_order():
                if message.log_time >= start and (stop is None or message.log_time <= stop):
                    yield channel, message
            return
        self._begin()
        self._take(found)
        self.damage.complete = True
        chunks = [c for c in found.chunks if c.end >= start and (stop is None or c.start <= stop)]
        chunks.sort(key=lambda chunk: chunk.start)
        waiting: list[tuple[int, int, RawMessage]] = []
        number = 0
        for i, given in enumerate(chunk_records(self.path, ((c.offset, c.length) for c in chunks), self.damage)):
            for record in given:
                if isinstance(record, RawMessage) and record.log_time >= start:
                    heappush(waiting, (record.log_time, number, record))
                    number += 1
            until = chunks[i + 1].start if i + 1 < len(chunks) else None
            while waiting and (until is None or waiting[0][0] < until):
                message = heappop(waiting)[2]
                if stop is not None and message.log_time > stop:
                    return
                known = self.channels.get(message.channel)
                if known is None:
                    self._leave_out("message of an unknown channel")
                else:
                    yield known, message

    def _take(self, found: Summary) -> None:
        """Take what a summary says of the file."""
        self.library = found.library
        for record in found.metadata:
            if record.name == RUN:
                self.run = {key: _value(text) for key, text in record.metadata.items()}
        self.channels = {
            number: _channel(record, found.schemas.get(record.schema_id)) for number, record in found.channels.items()
        }

    def _leave_out(self, reason: str) -> None:
        self.unreadable[reason] = self.unreadable.get(reason, 0) + 1

    def file_order(self) -> Iterator[tuple[LogChannel, RawMessage]]:
        """Yield channels and undecoded messages as they stand in the file; one of no known channel is counted.

        Raises
        ------
        InputError
            The file cannot be opened or is not MCAP.
        """
        self._begin()
        schemas: dict[int, Schema] = {}
        for record in records(self.path, self.damage):
            if isinstance(record, RawMessage):
                channel = self.channels.get(record.channel)
                if channel is None:
                    self._leave_out("message of an unknown channel")
                else:
                    yield channel, record
            elif isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                known = self.channels.get(record.id)
                if known is None or not known.count:  # a later copy may be the one with a checksum
                    self.channels[record.id] = _channel(record, schemas.get(record.schema_id))
            elif isinstance(record, Metadata) and record.name == RUN:
                self.run = {key: _value(text) for key, text in record.metadata.items()}
            elif isinstance(record, Header):
                self.library = record.library


def _channel(record: Channel, schema: Schema | None) -> LogChannel:
    name, encoding, definition = ("", "", b"") if schema is None else (schema.name, schema.encoding, schema.data)
    out = LogChannel(record.topic, record.message_encoding, name, record.metadata, encoding, definition)
    out.wall_clock = record.metadata.get("wall_clock") == "true"
    if record.message_encoding == ENCODING and record.metadata.keys() >= {"stream", "type"}:
        out.stream = record.metadata["stream"]
        out.type = record.metadata["type"]
    return out


def _value(text: str) -> Any:
    try:
        return msgspec.json.decode(text)
    except msgspec.DecodeError:
        return text
