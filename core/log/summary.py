"""The end of a finished MCAP file: channels, counts and where the chunks are, without reading the data."""

import struct
from dataclasses import dataclass, field
from io import BytesIO
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Footer, Header, Metadata, MetadataIndex, Schema, Statistics

from knotwork.core.log.records import open_log
from knotwork.core.log.writer import MAGIC

_FOOTER = 9 + 20
_RECORD = struct.Struct("<BQ")
_CHUNK_INDEX = struct.Struct("<QQQQI")  # start, end, offset, length of the chunk, bytes of the map that follows
_KINDS: dict[int, Any] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA_INDEX: MetadataIndex,
}


@dataclass(frozen=True, slots=True)
class ChunkPlace:
    """Where a chunk is and when its messages were logged.

    Attributes
    ----------
    start, end
        First and last log time [ns].
    offset, length
        Of its record in the file.
    indexes
        Offset of the message index by channel.
    """

    start: int
    end: int
    offset: int
    length: int
    indexes: dict[int, int]


@dataclass(slots=True)
class Summary:
    """What a finished file says of itself; `spans` are the first and last log time [ns] by channel."""

    library: str = ""
    profile: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    statistics: Statistics | None = None
    chunks: list[ChunkPlace] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    spans: dict[int, tuple[int, int]] = field(default_factory=dict)


def summary(path: Path) -> Summary | None:
    """Return the summary of a file; None when it has none (cut short, or written without) or it makes no sense.

    Raises
    ------
    InputError
        The file cannot be opened or is not MCAP.
    """
    with open_log(path) as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
        at = len(data) - len(MAGIC) - _FOOTER
        if at < len(MAGIC) or data[-len(MAGIC) :] != MAGIC or data[at] != Opcode.FOOTER:
            return None
        try:
            return _read(data, at)
        except (struct.error, McapError, ValueError, IndexError, UnicodeDecodeError):
            return None


def _read(data: mmap, end: int) -> Summary | None:
    footer: Footer = Footer.read(_stream(data[end + _RECORD.size : len(data) - len(MAGIC)]))
    at = footer.summary_start
    if not 0 < at < end:
        return None
    out = Summary()
    while at < end:
        opcode, length = _RECORD.unpack_from(data, at)
        at += _RECORD.size
        body = data[at : at + length]
        at += length
        if opcode == Opcode.CHUNK_INDEX:
            out.chunks.append(_chunk_place(body))
        elif (kind := _KINDS.get(opcode)) is not None:
            record = kind.read(_stream(body))
            if isinstance(record, Schema):
                out.schemas[record.id] = record
            elif isinstance(record, Channel):
                out.channels[record.id] = record
            elif isinstance(record, Statistics):
                out.statistics = record
            else:
                out.metadata.append(Metadata.read(_stream(data[record.offset + _RECORD.size :][: record.length])))
    if out.statistics is None:
        return None
    _, length = _RECORD.unpack_from(data, len(MAGIC))
    header = Header.read(_stream(data[len(MAGIC) + _RECORD.size :][:length]))
    out.library, out.profile = header.library, header.profile
    _spans(data, out)
    return out


def _chunk_place(body: bytes) -> ChunkPlace:
    start, end, offset, length, size = _CHUNK_INDEX.unpack_from(body)
    pairs = struct.iter_unpack("<HQ", body[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size])
    return ChunkPlace(start, end, offset, length, dict(pairs))


def _spans(data: mmap, out: Summary) -> None:
    """Read the first and the last message index of each channel."""
    for channel in out.channels:
        own = [chunk for chunk in out.chunks if channel in chunk.indexes]
        first = last = -1
        for chunk in sorted(own, key=lambda chunk: chunk.start):
            if 0 <= first <= chunk.start:
                break  # no later one can begin before it
            times = _index_times(data, chunk.indexes[channel])
            first = min(times) if first < 0 else min(first, *times)
        for chunk in sorted(own, key=lambda chunk: -chunk.end):
            if last >= chunk.end:
                break
            last = max(last, *_index_times(data, chunk.indexes[channel]))
        if own:
            out.spans[channel] = first, last


def _index_times(data: mmap, at: int) -> tuple[int, ...]:
    opcode, _ = _RECORD.unpack_from(data, at)
    _, size = struct.unpack_from("<HI", data, at + _RECORD.size)
    if opcode != Opcode.MESSAGE_INDEX:
        raise ValueError("not a message index")
    times: tuple[int, ...] = struct.unpack_from(f"<{size // 8}Q", data, at + _RECORD.size + 6)[::2]
    return times


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))
