"""The records of an MCAP file one by one, whatever state the file is in: cut short, a chunk damaged."""

import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from knotwork.core.errors import InputError
from knotwork.core.log.writer import MAGIC

_FOOTER_SIZE = 9 + 20 + len(MAGIC)
_ENDS = {int(Opcode.DATA_END): 4, int(Opcode.FOOTER): 20}  # length of the records that end the data section
_CHUNK_LIMIT = 1 << 30  # bytes; a larger claim is damage, not a chunk
_OTHER: dict[int, Any] = {Opcode.HEADER: Header, Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel}
_OTHER |= {Opcode.METADATA: Metadata, Opcode.ATTACHMENT: Attachment}
_CHUNK_HEAD = struct.Struct("<QQQII")  # start, end, uncompressed size, CRC, length of compression's name
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_RECORD = struct.Struct("<BQ")
_NAMES = (b"\4\0\0\0zstd", b"\3\0\0\0lz4")  # as they stand in a chunk; by them a chunk is found again

_BROKEN = (
    struct.error,
    McapError,
    UnicodeDecodeError,
    zstandard.ZstdError,
    RuntimeError,
    ValueError,
    MemoryError,
)


class RawMessage(NamedTuple):
    """A message record: ids and times [ns] as in the file, `data` in the channel's encoding."""

    channel: int
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


Record = Header | Schema | Channel | Metadata | Attachment | RawMessage


@dataclass(slots=True)
class Damage:
    """What a pass over a file found wrong; all zero and `complete` for a finished file."""

    complete: bool = False  # the file has its end, so ordinary readers open it
    damaged_chunks: int = 0  # skipped whole
    damaged_records: int = 0  # others that made no sense
    lost_bytes: int = 0  # not within any record that could be read
    notes: list[str] = field(default_factory=list)  # one line for each finding, with its byte


def records(path: Path, damage: Damage) -> Iterator[Record]:
    """Yield the records of the data section in file order, those inside chunks included.

    Never fails on damage: what cannot be read is skipped and counted in `damage`.

    Raises
    ------
    InputError
        The file cannot be opened or is not MCAP.
    """
    with open_log(path) as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
        size = len(data)
        at = before = len(MAGIC)
        while at < size:
            opcode, length = _head(data, at)
            if _ENDS.get(opcode) == length:
                damage.complete = data[-_FOOTER_SIZE] == Opcode.FOOTER and data[-len(MAGIC) :] == MAGIC
                return
            if not opcode or opcode in _ENDS:
                # The length of the record before may be what is wrong: search from there.
                found = _next_chunk(data, before + 1)
                damage.lost_bytes += max(found - at, 0)
                damage.notes.append(f"byte {at}: {'cut short' if found == size else 'not a record'}")
                at = before = found
                continue
            before = at
            at += _RECORD.size + length
            try:
                yield from _read(opcode, data[before + _RECORD.size : at])
            except _BROKEN as error:
                if opcode == Opcode.CHUNK:
                    damage.damaged_chunks += 1
                else:
                    damage.damaged_records += 1
                damage.lost_bytes += length
                name = Opcode(opcode).name.lower()
                damage.notes.append(f"byte {before}: {name} unreadable: {error or type(error).__name__}")


def chunk_records(path: Path, chunks: Iterable[tuple[int, int]], damage: Damage) -> Iterator[list[Record]]:
    """Yield the records of each chunk at these (offset, length); of a damaged chunk none, and it is counted.

    Raises
    ------
    InputError
        The file cannot be opened or is not MCAP.
    """
    with open_log(path) as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
        for offset, length in chunks:
            try:
                opcode, size = _head(data, offset)
                if opcode != Opcode.CHUNK or size + _RECORD.size != length:
                    raise ValueError("its index points elsewhere")
                found = _chunk_records(_chunk_data(data[offset + _RECORD.size : offset + length]))
            except _BROKEN as error:
                damage.damaged_chunks += 1
                damage.lost_bytes += length
                damage.notes.append(f"byte {offset}: chunk unreadable: {error or type(error).__name__}")
                found = []
            yield found


def _head(data: mmap, at: int) -> tuple[int, int]:
    """Return opcode and length of the record at a byte; (0, 0) where there is no whole record."""
    if at + _RECORD.size > len(data):
        return 0, 0
    opcode, length = _RECORD.unpack_from(data, at)
    if not 0 < opcode <= Opcode.DATA_END or at + _RECORD.size + length > len(data):
        return 0, 0
    return opcode, length


def open_log(path: Path) -> BinaryIO:
    """Open an MCAP file; raises InputError when there is none or it is another format."""
    try:
        file = path.open("rb")
    except OSError as error:
        raise InputError(f"cannot open the log: {error.strerror}", where=str(path)) from error
    try:
        magic = file.read(len(MAGIC))
    except OSError as error:
        file.close()
        raise InputError(f"cannot read the log: {error.strerror}", where=str(path)) from error
    if magic != MAGIC:
        file.close()
        raise InputError("empty, not an MCAP log" if not magic else "not an MCAP log", where=str(path))
    return file


def _read(opcode: int, body: bytes) -> list[Record]:
    """Parse one record of the data section; a chunk gives all of its records or none."""
    if opcode == Opcode.MESSAGE:
        return [_message(body)]
    if opcode == Opcode.CHUNK:
        return _chunk_records(_chunk_data(body))
    kind = _OTHER.get(opcode)
    if kind is None:
        return []
    return [kind.read(ReadDataStream(BytesIO(body)))]


def _message(body: bytes) -> RawMessage:
    channel, sequence, log_time, publish_time = _MESSAGE_HEAD.unpack_from(body)
    return RawMessage(channel, sequence, log_time, publish_time, body[_MESSAGE_HEAD.size :])


def _chunk_data(body: bytes) -> bytes:
    _, _, size, crc, n = _CHUNK_HEAD.unpack_from(body)
    at = _CHUNK_HEAD.size + n
    compression = body[_CHUNK_HEAD.size : at]
    (length,) = struct.unpack_from("<Q", body, at)
    packed = body[at + 8 : at + 8 + length]
    if size > _CHUNK_LIMIT:
        raise ValueError(f"claims {size} bytes")
    if compression == b"zstd":
        data = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size) if size else b""
    elif compression == b"lz4":
        data = lz4.frame.decompress(packed)
    elif not compression:
        data = packed
    else:
        raise ValueError(f"unknown compression {compression!r}")
    if len(data) != size or (crc and zlib.crc32(data) != crc):
        raise ValueError("checksum is wrong")
    return data


def _chunk_records(data: bytes) -> list[Record]:
    out: list[Record] = []
    at = 0
    while at < len(data):
        opcode, length = _RECORD.unpack_from(data, at)
        at += _RECORD.size
        if opcode == Opcode.MESSAGE:
            out.append(_message(data[at : at + length]))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            out += _read(opcode, data[at : at + length])
        at += length
    return out


def _next_chunk(data: mmap, start: int) -> int:
    """Return where the next readable chunk at or after `start` begins, the file's size when there is none."""
    to_name = _RECORD.size + _CHUNK_HEAD.size - 4  # bytes of a chunk before its compression's name
    at = start + to_name
    while hits := [hit for hit in (data.find(name, at) for name in _NAMES) if hit >= 0]:
        begin = min(hits) - to_name
        opcode, length = _head(data, begin)
        if opcode == Opcode.CHUNK:
            with suppress(*_BROKEN):
                _chunk_data(data[begin + _RECORD.size : begin + _RECORD.size + length])
                return begin
        at = min(hits) + 1
    return len(data)
