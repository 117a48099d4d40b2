"""Files are read back with the independent `mcap` package; failing disks are played by a file object."""

import errno
import io
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Attachment, Chunk
from mcap.stream_reader import StreamReader

from knotwork.core.log.writer import McapWriter


class SmallDisk(io.BytesIO):
    """A disk with room for `room` bytes; it takes what fits, then says ENOSPC, as a kernel does."""

    def __init__(self, room, portion=1 << 30):
        super().__init__()
        self.room, self.portion = room, portion

    def write(self, data):
        free = self.room - self.tell()
        if free <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(bytes(data[: min(free, self.portion)]))


def fill(writer, n, size=200, start=0):
    schema = writer.register_schema("s", "jsonschema", b"{}")
    channel = writer.register_channel("/a", "json", schema, {"key": "value"})
    for i in range(start, start + n):
        writer.add(channel, 10 * i, 10 * i - 5 if i else 0, i, bytes([i % 251]) * size)
    return channel


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
@pytest.mark.parametrize("level", [None, 1])
def test_independent_reader_opens_it(compression, level):
    file = io.BytesIO()
    writer = McapWriter(file, compression=compression, level=level, chunk_size=4096, profile="p", library="l")
    writer.add_metadata("first", {"a": "b"})
    fill(writer, 500)
    writer.flush()
    writer.add_metadata("second", {"c": "d"})
    writer.add_attachment(Attachment(create_time=1, log_time=2, name="n", media_type="text/plain", data=b"xyz"))
    writer.finish()
    file.seek(0)
    reader = make_reader(file, validate_crcs=True)
    header = reader.get_header()
    assert (header.profile, header.library) == ("p", "l")
    found = list(reader.iter_messages())
    assert [m.log_time for _, _, m in found] == [10 * i for i in range(500)]
    assert [m.sequence for _, _, m in found] == list(range(500))
    assert found[7][2].publish_time == 65
    assert found[7][2].data == bytes([7]) * 200
    assert found[7][1].metadata == {"key": "value"}
    assert found[7][0].name == "s"
    assert [(m.name, m.metadata) for m in reader.iter_metadata()] == [
        ("first", {"a": "b"}),
        ("second", {"c": "d"}),
    ]
    assert [a.data for a in reader.iter_attachments()] == [b"xyz"]
    summary = reader.get_summary()
    counts = summary.statistics
    assert counts.message_count == 500
    assert counts.channel_message_counts == {1: 500}
    assert counts.chunk_count == len(summary.chunk_indexes) > 10
    assert (counts.message_start_time, counts.message_end_time) == (0, 4990)
    # The indexes lead to the right chunks: a reader that seeks finds a window in the middle.
    window = [m.log_time for _, _, m in reader.iter_messages(starting_at=1005, ending_before=1055)]
    assert window == [1010, 1020, 1030, 1040, 1050]


def test_checksums_of_chunks_and_of_the_data_section():
    file = io.BytesIO()
    writer = McapWriter(file, chunk_size=2000)
    fill(writer, 100)
    writer.finish()
    raw = file.getvalue()
    assert list(StreamReader(io.BytesIO(raw), validate_crcs=True).records)
    chunks = [r for r in StreamReader(io.BytesIO(raw), emit_chunks=True).records if isinstance(r, Chunk)]
    assert all(chunk.uncompressed_crc for chunk in chunks)
    at = raw.index(chunks[3].data)
    damaged = bytearray(raw)
    damaged[at + len(chunks[3].data) // 2] ^= 0x40
    with pytest.raises(Exception, match=r"(?i)crc|zstd|decompress"):
        list(StreamReader(io.BytesIO(bytes(damaged)), validate_crcs=True).records)


def test_empty_log_is_a_whole_file():
    file = io.BytesIO()
    McapWriter(file).finish()
    file.seek(0)
    assert make_reader(file, validate_crcs=True).get_summary().statistics.message_count == 0


def test_flush_without_messages_writes_no_chunk():
    file = io.BytesIO()
    writer = McapWriter(file)
    size = writer.size
    writer.flush()
    assert file.tell() == size == writer.size


@given(room=st.integers(100, 6000), portion=st.integers(1, 4000))
def test_full_disk_keeps_whole_chunks(room, portion):
    disk = SmallDisk(room, portion)
    try:
        writer = McapWriter(disk, chunk_size=1000, compression="none")
    except OSError:
        return
    failed = 0
    schema = writer.register_schema("s", "jsonschema", b"{}")
    channel = writer.register_channel("/a", "json", schema, {})
    for i in range(60):
        try:
            writer.add(channel, i, i, i, bytes(100))
        except OSError:
            failed += 1
    assert disk.getbuffer().nbytes == writer.size <= room
    # The disk gets room: the log goes on, and is whole at the end.
    disk.room = 1 << 30
    for i in range(60, 80):
        writer.add(channel, i, i, i, bytes(100))
    writer.finish()
    disk.seek(0)
    found = [m.log_time for _, _, m in make_reader(disk, validate_crcs=True).iter_messages()]
    assert found == sorted(set(found))
    assert set(range(60, 80)) <= set(found)
    assert len(found) + writer.dropped == 80
    assert (writer.dropped > 0) == (failed > 0)
    disk.seek(0)
    assert list(StreamReader(disk, validate_crcs=True).records)


def test_finish_on_a_full_disk_leaves_whole_chunks():
    disk = SmallDisk(3000)
    writer = McapWriter(disk, chunk_size=1000, compression="none")
    schema = writer.register_schema("s", "jsonschema", b"{}")
    channel = writer.register_channel("/a", "json", schema, {})
    for i in range(9):
        writer.add(channel, i, i, i, bytes(100))
    disk.room = writer.size + 10
    with pytest.raises(OSError, match="No space"):
        writer.finish()
    assert disk.getbuffer().nbytes == writer.size
    disk.seek(0)
    with pytest.raises(EndOfFile):
        list(StreamReader(disk).records)
