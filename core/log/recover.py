"""Make a log whole again that was cut short (kill -9, power, full disk) or has damaged chunks."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from mcap.records import Attachment, Channel, Header, Metadata, Schema

from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.log.records import Damage, RawMessage, Record, records
from knotwork.core.log.writer import McapWriter, sync


@dataclass(frozen=True, slots=True)
class Recovery:
    """What was saved and what was not."""

    path: Path  # the file written
    messages: int
    orphans: int  # messages whose channel was lost
    damage: Damage


def recover(path: Path, output: Path | None = None) -> Recovery:
    """Write all that can be read of a log to `<path>.recovered.mcap`, indexed and finished.

    Parameters
    ----------
    path
        The log; it is not changed.
    output
        Where to write instead; an existing file is replaced when all is written.

    Raises
    ------
    InputError
        The file cannot be opened or is not MCAP.
    KnotworkError
        The output cannot be written.
    """
    output = output or path.with_name(path.name + ".recovered.mcap")
    if output.exists() and output.samefile(path):
        raise InputError("the output must be another file than the log", where=str(output))
    damage = Damage()
    source = records(path, damage)
    first = next(source, None)  # opens the log before a file is made
    partial = output.with_name(output.name + ".partial")
    try:
        try:
            with partial.open("wb", buffering=0) as file:
                writer = McapWriter(file, profile=first.profile if isinstance(first, Header) else "")
                orphans = _copy(chain([first] if first else [], source), writer)
                writer.finish()
                sync(file)
            partial.replace(output)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise KnotworkError(f"cannot write the recovered log: {error.strerror}", where=str(output)) from error
    return Recovery(output, writer.messages, orphans, damage)


def _copy(source: Iterable[Record], writer: McapWriter) -> int:
    """Copy all records; return the number of messages whose channel is not known."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    new_schemas: dict[int, int] = {}
    new_channels: dict[int, int] = {}
    orphans = 0
    for record in source:
        if isinstance(record, RawMessage):
            number = new_channels.get(record.channel)
            if number is None:
                # Only now: of the copies before its first message, the last is the one with a checksum.
                channel = channels.get(record.channel)
                if channel is None:
                    orphans += 1
                    continue
                schema = schemas.get(channel.schema_id)
                if schema is not None and schema.id not in new_schemas:
                    new_schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
                number = new_channels[record.channel] = writer.register_channel(
                    channel.topic,
                    channel.message_encoding,
                    new_schemas[schema.id] if schema is not None else 0,
                    channel.metadata,
                )
            writer.add(number, record.log_time, record.publish_time, record.sequence, record.data)
        elif isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
        elif isinstance(record, Attachment):
            writer.add_attachment(record)
    return orphans
