"""Logs are read and recovered in whatever state they are; no damage may end in a crash."""

import errno
from io import BytesIO
from itertools import islice

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

from knotwork.core import codec
from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.log.digest import digest
from knotwork.core.log.reader import Log
from knotwork.core.log.recover import recover
from knotwork.core.log.writer import McapWriter
from knotwork.core.messages import Pose, Statistics, Twist

TYPES = {"base.twist": Twist, "loc.pose": Pose, "runtime.statistics": Statistics}


def message(i):
    if i % 3 == 0:
        return "base.twist", Twist(stamp=100 * i - 7, time=100 * i, seq=i, vx=0.1 * i)
    if i % 3 == 1:
        pose = np.array([i, -i, 0.1 * i])
        return "loc.pose", Pose(stamp=100 * i, time=100 * i, seq=i, role="estimate", pose=pose, scan_id=i)
    return "runtime.statistics", Statistics(stamp=100 * i, time=100 * i, seq=i, data={"ms": 0.5})


def write(path, n=300, *, change=None, finish=True, chunk_size=1500, compression="zstd", run="x"):
    with path.open("wb", buffering=0) as file:
        writer = McapWriter(file, chunk_size=chunk_size, compression=compression)
        writer.add_metadata("knotwork.run", {"name": f'"{run}"', "seed": "3", "odd": "not json"})
        channels = {}
        for stream, cls in TYPES.items():
            metadata = {"stream": stream, "type": cls.type_name}
            if cls is Statistics:
                metadata["wall_clock"] = "true"
            schema = writer.register_schema(f"knotwork.{cls.type_name}", "jsonschema", codec.json_schema(cls))
            channels[stream] = writer.register_channel("/" + stream, "msgpack", schema, metadata)
        for i in range(n):
            stream, found = message(i)
            if change:
                found = change(i, found)
            writer.add(channels[stream], found.time, max(found.stamp, 0), found.seq, codec.encode(found))
        if finish:
            writer.finish()
        else:
            writer.flush()
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write(tmp_path_factory.mktemp("log") / "whole.mcap")


def test_messages_in_order_with_their_types(whole):
    log = Log(whole)
    found = list(log.messages())
    assert [(stream, m.seq, type(m)) for stream, m in found] == [
        (message(i)[0], i, type(message(i)[1])) for i in range(300)
    ]
    assert found[3][1].vx == 0.1 * 3
    assert found[0][1].stamp == -7
    assert found[4][1].pose.tolist() == [4, -4, 0.1 * 4]
    assert log.run == {"name": "x", "seed": 3, "odd": "not json"}
    assert log.damage.complete
    assert not log.damage.lost_bytes
    assert not log.unreadable
    assert {c.stream: (c.count, c.wall_clock) for c in log.channels.values()} == {
        "base.twist": (100, False), "loc.pose": (100, False), "runtime.statistics": (100, True)
    }  # fmt: skip


def test_filters(whole):
    assert {s for s, _ in Log(whole).messages(streams={"loc.pose"})} == {"loc.pose"}
    assert {s for s, _ in Log(whole).messages(types={"twist"})} == {"base.twist"}
    assert {s for s, _ in Log(whole).messages(wall_clock=False)} == {"base.twist", "loc.pose"}


def test_scan_counts_without_decoding(whole):
    log = Log(whole)
    log.scan()
    pose = next(c for c in log.channels.values() if c.type == "pose")
    assert (pose.count, pose.first, pose.last) == (100, 100, 29800)


def test_unknown_types_and_damaged_payloads_are_counted(tmp_path):
    path = tmp_path / "log.mcap"
    with path.open("wb", buffering=0) as file:
        writer = McapWriter(file)
        for topic, kind, data in (
            ("/a", "nobody_knows", b"\x80"),
            ("/b", "twist", b"\xc1"),
            ("/c", "twist", None),
        ):
            channel = writer.register_channel(topic, "msgpack", 0, {"stream": topic, "type": kind})
            writer.add(channel, 1, 1, 1, codec.encode(Twist(stamp=1, vx=2.0)) if data is None else data)
        writer.add(99, 1, 1, 1, b"orphan")
        writer.finish()
    log = Log(path)
    assert [stream for stream, _ in log.messages()] == ["/c"]
    assert sum(log.unreadable.values()) == 3
    with pytest.raises(InputError, match="3 messages cannot be compared"):
        digest(path)


@pytest.mark.parametrize("content", [b"", b"# a carmen log\nFLASER 0\n", b"\x89MCAP", b"\x89PNG\r\n\x1a\n" + bytes(50)])
def test_another_format_is_an_input_error(tmp_path, content):
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    for act in (lambda: Log(path).scan(), lambda: recover(path), lambda: digest(path)):
        with pytest.raises(InputError, match="not an MCAP log"):
            act()
    assert list(tmp_path.iterdir()) == [path]


def test_missing_file_and_folder_are_input_errors(tmp_path):
    for path in (tmp_path / "none.mcap", tmp_path):
        with pytest.raises(InputError, match="cannot open the log"):
            Log(path).scan()


def test_log_of_the_independent_writer(tmp_path):
    for compression in CompressionType:
        path = tmp_path / f"{compression.name}.mcap"
        with path.open("wb") as file:
            writer = Writer(file, compression=compression, chunk_size=500)
            writer.start()
            schema = writer.register_schema("s", "jsonschema", b"{}")
            channel = writer.register_channel("/a", "msgpack", schema, {"stream": "n.p", "type": "twist"})
            for i in range(50):
                writer.add_message(channel, i, codec.encode(Twist(stamp=i, vx=1.0)), i)
            writer.finish()
        assert [m.stamp for _, m in Log(path).messages()] == list(range(50))


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_recover_from_a_cut_at_any_byte(tmp_path, compression, data):
    path = tmp_path / f"{compression}.mcap"
    if not path.exists():
        write(path, compression=compression)
    raw = path.read_bytes()
    cut = tmp_path / "cut.mcap"
    at = data.draw(st.integers(8, len(raw)))
    cut.write_bytes(raw[:at])
    done = recover(cut)
    assert done.damage.complete == (at == len(raw))
    expected = whole_chunks(raw, at)
    assert done.messages == expected
    assert done.path == tmp_path / "cut.mcap.recovered.mcap"
    with done.path.open("rb") as file:  # whole for an ordinary reader
        assert [m.sequence for _, _, m in make_reader(file, validate_crcs=True).iter_messages()] == list(
            range(expected)
        )
    assert [m.seq for _, m in Log(done.path).messages()] == list(range(expected))
    assert [m.seq for _, m in Log(cut).messages()] == list(range(expected))


def whole_chunks(raw, at):
    """Return how many messages lie in chunks that end at or before a byte, by the file's own index."""
    summary = make_reader(BytesIO(raw)).get_summary()
    ends = [(i.chunk_start_offset, i.chunk_start_offset + i.chunk_length) for i in summary.chunk_indexes]
    return sum(_messages_in(raw[begin:end]) for begin, end in ends if end <= at)


def _messages_in(chunk_record):
    (chunk,) = islice(StreamReader(BytesIO(chunk_record), skip_magic=True, emit_chunks=True).records, 1)
    return sum(isinstance(record, Message) for record in breakup_chunk(chunk))


@settings(deadline=None, max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_recover_from_damage_anywhere(tmp_path, whole, data):
    raw = bytearray(whole.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(8, len(raw) - 1))
        noise = data.draw(st.binary(min_size=1, max_size=12))
        raw[start : start + len(noise)] = noise
    path = tmp_path / "damaged.mcap"
    path.write_bytes(raw)
    done = recover(path)
    with done.path.open("rb") as file:
        make_reader(file, validate_crcs=True).get_summary()
        file.seek(0)
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == done.messages
    list(Log(path).messages())


@settings(deadline=None, max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.integers(8, 100_000), change=st.integers(1, 255))
@example(at=8, change=3)  # the first record says it is the footer
def test_a_changed_byte_changes_no_message(tmp_path, whole, at, change):
    """Checksums stand before messages and channels: what is decoded is what was recorded."""
    raw = bytearray(whole.read_bytes())
    raw[at % (len(raw) - 8) + 8 if at >= len(raw) else at] ^= change
    path = tmp_path / "damaged.mcap"
    path.write_bytes(raw)
    found = list(Log(path).messages())
    assert len(found) > 200
    for stream, read in found:
        assert stream == message(read.seq)[0]
        assert codec.encode(read) == codec.encode(message(read.seq)[1])


def chunk_offsets(path):
    with path.open("rb") as file:
        return [(i.chunk_start_offset, i.chunk_length) for i in make_reader(file).get_summary().chunk_indexes]


@pytest.mark.parametrize("where", ["data", "length too long", "length huge", "opcode", "index length"])
def test_one_damaged_chunk_costs_one_chunk(tmp_path, whole, where):
    raw = bytearray(whole.read_bytes())
    chunks = chunk_offsets(whole)
    begin, length = chunks[2]
    lost = _messages_in(bytes(raw[begin : begin + length]))
    if where == "data":
        raw[begin + length - 20] ^= 0xFF
    elif where == "length too long":
        raw[begin + 1 : begin + 9] = (length + 2000).to_bytes(8, "little")
        lost = 0  # what it holds is still sound, and so is what it claims to hold
    elif where == "length huge":
        raw[begin + 8] = 0x70
    elif where == "opcode":
        raw[begin] = 0xEE
    else:  # the message index behind the chunk swallows the next ones
        raw[begin + length + 1 : begin + length + 9] = (3000).to_bytes(8, "little")
        lost = 0
    path = tmp_path / "damaged.mcap"
    path.write_bytes(raw)
    done = recover(path)
    assert done.messages == 300 - lost
    log = Log(path)
    assert len(list(log.messages())) == 300 - lost
    assert log.damage.notes
    if where == "data":
        assert log.damage.damaged_chunks == 1


def test_recover_writes_all_or_nothing(tmp_path, whole, monkeypatch):
    path = tmp_path / "log.mcap"
    path.write_bytes(whole.read_bytes())
    with pytest.raises(InputError, match="another file"):
        recover(path, path)

    def full(self, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(McapWriter, "_write", full)
    with pytest.raises(KnotworkError, match="cannot write the recovered log: No space left"):
        recover(path)
    assert list(tmp_path.iterdir()) == [path]


def test_recovering_a_whole_log_changes_nothing(tmp_path, whole):
    done = recover(whole, tmp_path / "again.mcap")
    assert (done.messages, done.orphans, done.damage.complete) == (300, 0, True)
    assert digest(done.path) == digest(whole)
    with done.path.open("rb") as file:
        assert [m.name for m in make_reader(file).iter_metadata()] == ["knotwork.run"]


def test_digest_is_of_the_decisions_only(tmp_path, whole):
    same = write(tmp_path / "same.mcap", chunk_size=700, compression="lz4", run="another")
    assert digest(same) == digest(whole)

    def slower(i, found):
        return Statistics(stamp=1, time=found.time, seq=i, data={"ms": 9.0}) if i % 3 == 2 else found

    assert digest(write(tmp_path / "slower.mcap", change=slower)) == digest(whole)

    def moved(i, found):
        return Twist(stamp=found.stamp, time=found.time, seq=i, vx=np.nextafter(found.vx, 9)) if i == 150 else found

    assert digest(write(tmp_path / "moved.mcap", change=moved)) != digest(whole)
    assert digest(write(tmp_path / "short.mcap", n=299)) == digest(whole)  # the last one is wall clock
    assert digest(write(tmp_path / "shorter.mcap", n=298)) != digest(whole)
    assert digest(tmp_path / "moved.mcap", streams=frozenset({"loc.pose"})) == digest(
        whole, streams=frozenset({"loc.pose"})
    )
