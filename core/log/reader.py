"""A log as messages: which streams it has, who made it, and every message in the order of the run."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Channel, Header, Metadata, Schema

from knotwork.core import codec
from knotwork.core.errors import InputError
from knotwork.core.log.records import Damage, RawMessage, records
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

    def scan(self) -> None:
        """Read the whole file for its channels, counts, times and damage.

        Raises
        ------
        InputError
            The file cannot be opened or is not MCAP.
        """
        for channel, message in self._raw():
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
        for channel, raw in self._raw():
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
                self.unreadable[error.message] = self.unreadable.get(error.message, 0) + 1
            else:
                yield channel.stream, message

    def _raw(self) -> Iterator[tuple[LogChannel, RawMessage]]:
        """Yield messages with their channels; a message of no known channel is counted."""
        self._begin()
        schemas: dict[int, str] = {}
        for record in records(self.path, self.damage):
            if isinstance(record, RawMessage):
                channel = self.channels.get(record.channel)
                if channel is None:
                    reason = "message of an unknown channel"
                    self.unreadable[reason] = self.unreadable.get(reason, 0) + 1
                else:
                    yield channel, record
            elif isinstance(record, Schema):
                schemas[record.id] = record.name
            elif isinstance(record, Channel):
                known = self.channels.get(record.id)
                if known is None or not known.count:  # a later copy may be the one with a checksum
                    self.channels[record.id] = _channel(record, schemas.get(record.schema_id, ""))
            elif isinstance(record, Metadata) and record.name == RUN:
                self.run = {key: _value(text) for key, text in record.metadata.items()}
            elif isinstance(record, Header):
                self.library = record.library


def _channel(record: Channel, schema: str) -> LogChannel:
    out = LogChannel(record.topic, record.message_encoding, schema, record.metadata)
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
