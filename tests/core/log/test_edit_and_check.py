"""Finished logs looked at, checked, cut and merged; other people's readers agree."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from knotwork.core.cli.main import main
from knotwork.core.log.check import check
from knotwork.core.log.edit import cut, merge
from knotwork.core.log.reader import Log
from knotwork.core.log.summary import summary

SCRIPT = Path(__file__).with_name("read_mcap.js")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A log of a run of four seconds, in many chunks."""
    folder = tmp_path_factory.mktemp("run")
    file = folder / "run.yaml"
    file.write_text(
        "pipeline: p\nnodes:\n  sim: {plugin: sim2d, duration: 4}\n  prior: {plugin: ekf}\n"
        "  recorder: {plugin: mcap, chunk_size: 4096}\n"
    )
    assert main(["run", str(file), "--out", str(folder), "--quiet"]) == 0
    return folder / "log.mcap"


def test_the_overview_is_what_reading_it_all_gives_and_does_not_touch_the_data(log, monkeypatch):
    full, quick = Log(log), Log(log)
    full.scan()
    monkeypatch.setattr("knotwork.core.log.reader.records", None)
    monkeypatch.setattr("knotwork.core.log.reader.chunk_records", None)
    quick.overview()
    assert quick.run == full.run
    assert quick.damage.complete
    assert quick.library == full.library

    def told(one):
        return {c.topic: (c.schema, c.count, c.first, c.last, c.stream) for c in one.channels.values()}

    assert told(quick) == told(full)


def test_a_part_is_read_without_what_is_outside(log, monkeypatch):
    from knotwork.core.log import records

    read = []
    real = records._chunk_data
    monkeypatch.setattr(records, "_chunk_data", lambda body: read.append(1) or real(body))
    times = [m.log_time for _, m in Log(log).raw(10**9, 2 * 10**9)]
    part = len(read)
    assert times == sorted(times)
    assert (times[0], times[-1]) == (10**9, 2 * 10**9)
    read.clear()
    everything = [m.log_time for _, m in Log(log).raw()]
    assert [t for t in everything if 10**9 <= t <= 2 * 10**9] == times
    assert part < len(read) / 2


def test_a_sound_log_is_sound(log):
    found = check(log)
    assert found.problems == []
    assert found.missing == 0
    with log.open("rb") as file:
        assert found.messages == make_reader(file, validate_crcs=True).get_summary().statistics.message_count


def test_python_s_reader_agrees(log):
    with log.open("rb") as file:
        times = [
            record.log_time for record in StreamReader(file, validate_crcs=True).records if hasattr(record, "log_time")
        ]
        file.seek(0)
        reader = make_reader(file, validate_crcs=True)
        counts = reader.get_summary().statistics.channel_message_counts
        indexed = sum(1 for _ in reader.iter_messages())
    assert times == sorted(times)
    assert indexed == len(times) == sum(counts.values())


def test_node_s_reader_agrees(log):
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node")
    have = subprocess.run(
        [node, "-e", "for (const p of ['core', 'support', 'nodejs']) require('@mcap/' + p)"],
        capture_output=True,
        check=False,
    )
    if have.returncode:
        pytest.skip("node has no @mcap/core, @mcap/support, @mcap/nodejs (npm install, NODE_PATH)")
    done = subprocess.run([node, SCRIPT, log], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    ours = Log(log)
    ours.scan()
    assert found["counts"] == {c.topic: c.count for c in ours.channels.values() if c.count}
    assert found["falls"] == 0
    assert found["done"]
    assert ["knotwork.scan", "jsonschema"] in found["schemas"]
    assert ["foxglove.LaserScan", "protobuf"] in found["schemas"]


def damaged(log, tmp_path, place, how):
    """Damage a copy: inside the third chunk, in the message indexes behind it, in the summary."""
    chunk = summary(log).chunks[2]
    at = {"chunk": chunk.offset + 300, "index": chunk.offset + chunk.length + 30, "summary": -200}[place]
    path = tmp_path / "damaged.mcap"
    data = bytearray(log.read_bytes())
    how(data, at if at >= 0 else len(data) + at)
    path.write_bytes(data)
    return path


def flip(data, at):
    data[at] ^= 0x40


def end(data, at):
    del data[at:]


@pytest.mark.parametrize(
    ("place", "how", "says"),
    [
        ("chunk", flip, "chunk unreadable"),
        ("chunk", end, "it has no end"),
        ("index", flip, "the checksum of the data is wrong"),
        ("summary", flip, "summary"),
    ],
)
def test_what_is_wrong_is_found(log, tmp_path, place, how, says):
    found = check(damaged(log, tmp_path, place, how))
    assert found.problems
    assert any(says in text for text in found.problems), found.problems


def test_a_part_of_some_streams(log, tmp_path):
    done = cut(log, tmp_path / "cut.mcap", start=1.0, stop=2.0, wanted=lambda c: c.stream == "sim.odometry")
    assert check(done.path).problems == []
    part = [m for _, m in Log(done.path).messages()]
    whole = [m for _, m in Log(log).messages(streams={"sim.odometry"})]
    assert [m.stamp for m in part] == [m.stamp for m in whole if 10**9 <= m.stamp <= 2 * 10**9]
    np.testing.assert_array_equal(part[0].pose, next(m for m in whole if m.stamp == part[0].stamp).pose)
    about = Log(done.path)
    about.overview()
    assert about.run["cut"] == [1.0, 2.0]
    assert about.run["config"]


def test_some_streams_keep_the_frames_they_are_shown_in(log, tmp_path):
    """Read by the `mcap` package and protobuf: the scans' frame has its place."""
    output = tmp_path / "scans.mcap"
    assert main(["log", "cut", str(log), "--streams", "sim.scan", "--output", str(output)]) == 0
    parents, scans = {}, 0
    with output.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            if channel.topic == "/tf":
                transform = FrameTransform.FromString(message.data)
                parents[transform.child_frame_id] = transform.parent_frame_id
            elif channel.topic == "/sim/scan":
                frame, scans = LaserScan.FromString(message.data).frame_id, scans + 1
    assert scans > 5
    assert parents == {frame: "odom"}  # nothing in this run says where `odom` is


def test_parts_merged_are_the_whole(log, tmp_path):
    parts = [
        cut(log, tmp_path / f"{i}.mcap", wanted=lambda c, i=i: (c.topic.count("a") % 2) == i).path for i in range(2)
    ]
    merged = merge(parts, tmp_path / "merged.mcap")
    assert check(merged.path).problems == []
    key = [(c.topic, m.log_time, m.sequence) for c, m in Log(log).raw()]
    assert sorted((c.topic, m.log_time, m.sequence) for c, m in Log(merged.path).raw()) == sorted(key)


def test_a_log_is_never_its_own_output(log, capsys):
    before = log.read_bytes()
    assert main(["log", "cut", str(log), "--output", str(log)]) == 2
    assert main(["log", "merge", str(log), "--output", str(log)]) == 2
    assert capsys.readouterr().err.count("another file") == 2
    assert log.read_bytes() == before
    assert not list(log.parent.glob("*.partial"))


def test_the_commands(log, tmp_path, capsys):
    output = tmp_path / "part.mcap"
    argv = ["log", "cut", str(log), "--from", "1", "--to", "2", "--streams", "sim.scan", "prior.*"]
    assert main([*argv, "--output", str(output)]) == 0
    topics = {c.topic for c, _ in Log(output).raw()}
    assert topics == {
        "/knotwork/sim/scan", "/sim/scan", "/knotwork/prior/prior", "/prior/prior", "/tf"
    }  # fmt: skip
    assert main(["log", "check", str(log), str(output)]) == 0
    assert main(["log", "check", str(damaged(log, tmp_path, "chunk", flip))]) == 1
    said = capsys.readouterr().out
    assert f"{log}: sound; " in said
    assert "dispatched messages are not in it" in said
    assert "chunk unreadable" in said
    assert main(["log", "cut", str(log), "--from", "2", "--to", "1"]) == 2
