"""Everything that must hold of a finished log, read through once."""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from knotwork.core import codec
from knotwork.core.errors import InputError
from knotwork.core.log.reader import Log, LogChannel
from knotwork.core.log.records import Damage, RawMessage, chunk_records
from knotwork.core.log.summary import Summary, summary
from knotwork.core.log.writer import MAGIC
from knotwork.core.message_types import message_class
from knotwork.core.messages import Message

_FOOTER = 9 + 20 + len(MAGIC)
_DATA_END = 9 + 4
_BLOCK = 1 << 20
_SHOWN = 5  # findings of one kind


@dataclass(slots=True)
class Findings:
    """What is wrong with a log.

    Attributes
    ----------
    problems
        One line each; none for a sound log.
    messages
        That were read.
    missing
        Dispatch numbers that no message has: left out by the recorder's config, dropped, or damaged.
    """

    problems: list[str] = field(default_factory=list)
    messages: int = 0
    missing: int = 0


def check(path: Path) -> Findings:
    """Read a log through: checksums, indexes, counts, times that never fall, every message decodable.

    Raises
    ------
    InputError
        The file cannot be opened or is not MCAP.
    """
    out = Findings()
    log = Log(path)
    falls = 0
    before = 0
    classes: dict[str, type[Message] | None] = {}
    last_seq = -1
    bad: dict[str, int] = {}
    for channel, message in log.file_order():
        channel.saw(message.log_time)
        out.messages += 1
        falls += message.log_time < before
        before = max(before, message.log_time)
        if channel.type:
            if text := _undecodable(channel, message, classes):
                bad[text] = bad.get(text, 0) + 1
            if message.sequence > last_seq:
                out.missing += message.sequence - last_seq - 1
                last_seq = message.sequence
    out.problems += log.damage.notes
    if not log.damage.complete:
        out.problems.append(f"it has no end: ordinary readers see nothing (knotwork log recover {path})")
    if falls:
        out.problems.append(f"log times fall {falls} times")
    out.problems += [f"{n} messages: {text}" for text, n in (bad | log.unreadable).items()]
    if log.damage.complete:
        out.problems += _end(path, log)
    return out


def _undecodable(channel: LogChannel, message: RawMessage, classes: dict[str, type[Message] | None]) -> str:
    try:
        if channel.type not in classes:
            classes[channel.type] = None
            classes[channel.type] = message_class(channel.type)
        cls = classes[channel.type]
        if cls is None:
            return f"of unknown type `{channel.type}`"
        codec.decode(cls, message.data)
    except InputError as error:
        return error.message
    return ""


def _end(path: Path, log: Log) -> Iterator[str]:
    found = summary(path)
    if found is None or found.statistics is None:
        yield "its summary is missing or makes no sense"
        return
    yield from _checksums(path)
    counted = {number: channel.count for number, channel in log.channels.items() if channel.count}
    if counted != {number: n for number, n in found.statistics.channel_message_counts.items() if n}:
        yield f"it claims {found.statistics.message_count} messages, {sum(counted.values())} were read"
    yield from list(_indexes(path, found))[:_SHOWN]


def _indexes(path: Path, found: Summary) -> Iterator[str]:
    given = chunk_records(path, ((c.offset, c.length) for c in found.chunks), Damage())
    for place, records in zip(found.chunks, given, strict=True):
        times = [record.log_time for record in records if isinstance(record, RawMessage)]
        channels = {record.channel for record in records if isinstance(record, RawMessage)}
        if times and ((min(times), max(times)) != (place.start, place.end) or channels != place.indexes.keys()):
            yield f"byte {place.offset}: the chunk is not what its index says"


def _checksums(path: Path) -> Iterator[str]:
    """Compare the checksums of data and summary with the bytes; 0 is "not computed"."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(size - _FOOTER + 9)
        start, _, of_summary = struct.unpack("<QQI", file.read(20))
        file.seek(start - 4)
        (of_data,) = struct.unpack("<I", file.read(4))
        if of_data not in (0, _crc(file, 0, start - _DATA_END)):
            yield "the checksum of the data is wrong: some byte has changed"
        if of_summary not in (0, _crc(file, start, size - _FOOTER + 25)):
            yield "the checksum of the summary is wrong: some byte has changed"


def _crc(file: BinaryIO, start: int, end: int) -> int:
    file.seek(start)
    crc = 0
    while start < end and (block := file.read(min(end - start, _BLOCK))):
        crc = zlib.crc32(block, crc)
        start += len(block)
    return crc
