"""An MCAP writer for logs that must survive: whole chunks or nothing, also on a full disk.

Format: https://mcap.dev/spec. Schemas and channels stand before the chunk that first uses them and again
in it: in the chunk a checksum guards them, before it they survive the chunk's damage. The record classes
of the `mcap` package write the rare records; messages and indexes, the many, are packed here.
"""

import os
import struct
import zlib
from collections import defaultdict
from collections.abc import Callable, Mapping
from typing import Any, Literal, Protocol

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC = b"\x89MCAP0\r\n"
Compression = Literal["zstd", "lz4", "none"]

# opcode, length; then channel, sequence, log time, publish time
_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_FIXED = _MESSAGE.size - 9  # of it, what the record's length counts
_pack_message = _MESSAGE.pack


class File(Protocol):
    """What is needed of an unbuffered binary file."""

    def write(self, data: memoryview, /) -> int | None:
        """Write some of `data`."""

    def seek(self, offset: int, /) -> int:
        """Go to a byte."""

    def truncate(self, size: int | None = None, /) -> int:
        """Cut the file."""


class McapWriter:
    """Writes one MCAP file with chunks, indexes, statistics and checksums.

    A write that fails (disk full) takes the file back to its last whole chunk and raises the OSError;
    the chunk's messages are lost and counted in `dropped`. Later writes may succeed again: the file
    stays well-formed throughout.

    Parameters
    ----------
    file
        Unbuffered (`open(path, "wb", buffering=0)`) and empty. Not closed here.
    compression, level
        Of the chunks; level None is the fastest (zstd 1, lz4 0).
    chunk_size
        A chunk is closed when its records reach this many bytes.
    profile, library
        For the header.
    """

    def __init__(
        self,
        file: File,
        *,
        compression: Compression = "zstd",
        level: int | None = None,
        chunk_size: int = 64 * 1024,
        profile: str = "",
        library: str = "knotwork",
    ) -> None:
        self._file = file
        self._compression = "" if compression == "none" else compression
        self._compress = _compressor(compression, level)
        self._chunk_size = chunk_size
        self.size = 0  # bytes of the file that are whole records
        self.dropped = 0  # messages lost to failed writes
        self.messages = 0  # messages that reached the file
        self._crc = 0
        self._definitions = b""  # schemas and channels that are not in the file yet
        self._loose = b""  # metadata and attachments that are not in the file yet
        self._schemas: list[bytes] = []
        self._channels: list[bytes] = []
        self._pending: list[MetadataIndex | AttachmentIndex] = []  # of records in `_loose`
        self._metadata_indexes: list[bytes] = []
        self._attachment_indexes: list[bytes] = []
        self._chunk_indexes: list[bytes] = []
        self._counts: dict[int, int] = {}
        self._start: int | None = None
        self._end = 0
        self._new_chunk()
        self._write(MAGIC + _record(Header(profile, library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema; return its id."""
        record = _record(Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data))
        self._schemas.append(record)
        self._define(record)
        return len(self._schemas)

    def register_channel(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Add a channel of a schema (0: none); return its id."""
        number = len(self._channels) + 1
        record = _record(
            Channel(id=number, topic=topic, message_encoding=encoding, schema_id=schema, metadata=dict(metadata))
        )
        self._channels.append(record)
        self._define(record)
        return number

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Add a named record of text keys and values, written with the next chunk or flush."""
        record = _record(Metadata(name=name, metadata=dict(data)))
        self._pending.append(MetadataIndex(offset=len(self._loose), length=len(record), name=name))
        self._loose += record

    def add_attachment(self, attachment: Attachment) -> None:
        """Add a file within the file, written with the next chunk or flush."""
        record = _record(attachment)
        self._pending.append(
            AttachmentIndex(
                offset=len(self._loose),
                length=len(record),
                log_time=attachment.log_time,
                create_time=attachment.create_time,
                data_size=len(attachment.data),
                name=attachment.name,
                media_type=attachment.media_type,
            )
        )
        self._loose += record

    def add(self, channel: int, log_time: int, publish_time: int, sequence: int, data: bytes) -> None:
        """Add a message; times in ns, not negative.

        Raises
        ------
        OSError
            This message completed a chunk that could not be written.
        """
        size = _MESSAGE_FIXED + len(data)
        records = self._records
        self._indexes[channel] += (log_time, len(records))
        records += _pack_message(5, size, channel, sequence & 0xFFFFFFFF, log_time, publish_time)
        records += data
        if len(records) >= self._chunk_size:
            self.flush()

    def flush(self) -> None:
        """Close the chunk in progress and write it; does not fsync.

        Raises
        ------
        OSError
            It could not be written; its messages are dropped.
        """
        if not (self._indexes or self._loose):
            return
        try:
            self._flush()
        finally:
            self._new_chunk()

    def finish(self) -> None:
        """Write the last chunk, the indexes and the footer.

        Raises
        ------
        OSError
            No room: the file ends after its last whole chunk and needs `recover`.
        """
        self.flush()
        end = _record(DataEnd(zlib.crc32(b"", self._crc)))
        start = self.size + len(end)
        groups: list[tuple[Opcode, list[bytes]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunk_indexes),
            (Opcode.ATTACHMENT_INDEX, self._attachment_indexes),
            (Opcode.METADATA_INDEX, self._metadata_indexes),
        ]
        summary = b""
        offsets = b""
        for opcode, records in groups:
            group = b"".join(records)
            if group:
                offset = SummaryOffset(group_opcode=opcode, group_start=start + len(summary), group_length=len(group))
                offsets += _record(offset)
            summary += group
        offset_start = start + len(summary)
        summary += offsets
        crc = zlib.crc32(struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start), zlib.crc32(summary))
        footer = _record(Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=crc))
        self._write(end + summary + footer + MAGIC)

    def _new_chunk(self) -> None:
        self._records = bytearray(self._definitions)  # of the chunk in progress
        self._indexes: defaultdict[int, list[int]] = defaultdict(list)  # channel: log time, offset, log time, ...

    def _define(self, record: bytes) -> None:
        self._definitions += record
        self._records += record

    def _flush(self) -> None:
        indexes = self._indexes
        n = sum(map(len, indexes.values())) // 2
        definitions = self._definitions if n else b""
        blob = [self._loose, definitions]
        base = self.size + len(self._loose) + len(definitions)
        chunk_index = b""
        if n:
            raw = self._records
            first = min(min(index[::2]) for index in indexes.values())
            last = max(max(index[::2]) for index in indexes.values())
            data = self._compress(raw)
            name = self._compression.encode()
            head = struct.pack(
                f"<QQQII{len(name)}sQ",
                first, last, len(raw), zlib.crc32(raw), len(name), name, len(data),
            )  # fmt: skip
            chunk_length = 9 + len(head) + len(data)
            blob += [struct.pack("<BQ", Opcode.CHUNK, chunk_length - 9), head, data]
            offsets = b""
            at = 0
            for channel, index in indexes.items():
                offsets += struct.pack("<HQ", channel, base + chunk_length + at)
                size = 8 * len(index)
                blob.append(struct.pack(f"<BQHI{len(index)}Q", Opcode.MESSAGE_INDEX, 6 + size, channel, size, *index))
                at += 15 + size
            body = struct.pack("<QQQQI", first, last, base, chunk_length, len(offsets))
            body += offsets + struct.pack(f"<QI{len(name)}sQQ", at, len(name), name, len(data), len(raw))
            chunk_index = struct.pack("<BQ", Opcode.CHUNK_INDEX, len(body)) + body
        try:
            at_start = self.size
            self._write(b"".join(blob))
        except OSError:
            self.dropped += n
            raise
        self._loose = b""
        for pending in self._pending:
            pending.offset += at_start
            kind = self._metadata_indexes if isinstance(pending, MetadataIndex) else self._attachment_indexes
            kind.append(_record(pending))
        self._pending = []
        if n:
            self._definitions = b""
            self._chunk_indexes.append(chunk_index)
            self.messages += n
            for channel, index in indexes.items():
                self._counts[channel] = self._counts.get(channel, 0) + len(index) // 2
            self._start = first if self._start is None else min(self._start, first)
            self._end = max(self._end, last)

    def _write(self, data: bytes) -> None:
        """Write all of `data`, or take the file back to where it was and raise."""
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) or 0 :]
        except OSError:
            self._file.seek(self.size)
            self._file.truncate(self.size)
            raise
        self.size += len(data)
        self._crc = zlib.crc32(data, self._crc)

    def _statistics(self) -> bytes:
        return _record(
            Statistics(
                attachment_count=len(self._attachment_indexes),
                channel_count=len(self._channels),
                channel_message_counts=self._counts,
                chunk_count=len(self._chunk_indexes),
                message_count=self.messages,
                message_end_time=self._end,
                message_start_time=self._start or 0,
                metadata_count=len(self._metadata_indexes),
                schema_count=len(self._schemas),
            )
        )


def sync(file: Any) -> None:
    """Make what was written survive a power cut; a file without a descriptor (a test's) has nothing to do."""
    fileno = getattr(file, "fileno", None)
    if fileno is not None:
        os.fsync(fileno())


def _record(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _compressor(compression: Compression, level: int | None) -> Callable[[bytes | bytearray], bytes]:
    if compression == "zstd":
        return zstandard.ZstdCompressor(level=1 if level is None else level).compress
    if compression == "lz4":
        strength = 0 if level is None else level

        def compress(data: bytes | bytearray) -> bytes:
            return bytes(lz4.frame.compress(data, compression_level=strength))

        return compress
    return bytes
