"""The recorder against independent readers, kill -9 and full disks."""

import errno
import os
import resource
import signal
import struct
import subprocess
import sys
import time
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from knotwork.core import message_types
from knotwork.core.errors import KnotworkError
from knotwork.core.log.digest import digest
from knotwork.core.log.reader import Log
from knotwork.core.log.recover import recover
from knotwork.core.messages import Event, Grid, Message, Odometry, Pose, Scan, Statistics, Transform
from knotwork.plugins.sinks.mcap import MANIFEST, McapConfig
from knotwork.plugins.sinks.mcap.recorder import McapRecorder

RUN = {"pipeline": "test", "config": {"nodes": {"a": [1, 2.5]}}, "versions": {"knotwork": "0"}, "seed": 7}


class FakeContext(SimpleNamespace):
    def __init__(self, out, **config):
        super().__init__(name="recorder", config=McapConfig(**config), options=None, uses={}, out=out, seed=0, run=RUN)
        self.reports, self.counts = [], {}

    def report(self, level, text):
        self.reports.append((level, text))

    def count(self, name, by=1):
        self.counts[name] = self.counts.get(name, 0) + by


def step(i):
    """Return what one scan brings, as (stream, message)."""
    t = 10**18 + i * 10**8
    common = {"stamp": t - 3, "time": t}
    at = np.array([0.1 * i, 0.2, 0.3])
    ranges = np.linspace(1, 5, 180, dtype=np.float32) + np.float32(i)
    return [
        ("log.odometry", Odometry(**common, seq=5 * i, pose=at)),
        (
            "log.scan",
            Scan(
                **common,
                seq=5 * i + 1,
                scan_id=i,
                ranges=ranges,
                angle_min=-1.57,
                angle_increment=0.0175,
                range_min=0.0,
                range_max=80.0,
                mount=(0.1, 0.0, 0.0),
            ),
        ),
        ("prior.pose", Pose(**common, seq=5 * i + 2, role="prior", pose=at)),
        (
            "localizer.pose",
            Pose(**common, seq=5 * i + 3, role="estimate", pose=at, covariance=np.eye(3), scan_id=i),
        ),
        ("prior.transform", Transform(**common, seq=5 * i + 4, parent="map", child="odom", pose=at)),
    ]


def record(out, n=40, extra=(), **config):
    context = FakeContext(out, **config)
    sink = McapRecorder(context)
    sink.open()
    for i in range(n):
        for stream, message in step(i):
            sink.on_message(stream, message)
    for stream, message in extra:
        sink.on_message(stream, message)
    sink.close()
    return sink, context


def topics(path):
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = {}
        for schema, channel, message, view in reader.iter_decoded_messages(
            [c.topic for c in reader.get_summary().channels.values() if c.message_encoding == "protobuf"]
        ):
            found.setdefault(channel.topic, []).append((schema, channel, message, view))
        return found


def test_an_independent_reader_sees_views_and_lossless_channels(tmp_path):
    sink, context = record(tmp_path)
    assert sink.path == tmp_path / "log.mcap"
    assert context.reports == []
    with sink.path.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
        file.seek(0)
        assert list(StreamReader(file, validate_crcs=True).records)
    lossless = {c.topic: c for c in summary.channels.values() if c.message_encoding == "msgpack"}
    assert lossless.keys() == {
        "/knotwork/log/odometry",
        "/knotwork/log/scan",
        "/knotwork/prior/pose",
        "/knotwork/localizer/pose",
        "/knotwork/prior/transform",
    }
    pose = lossless["/knotwork/localizer/pose"]
    assert pose.metadata.items() >= {"stream": "localizer.pose", "type": "pose", "role": "estimate"}.items()
    assert summary.schemas[pose.schema_id].name == "knotwork.pose"
    assert all(summary.statistics.channel_message_counts[c.id] == 40 for c in lossless.values())
    seen = topics(sink.path)
    assert {topic: (len(v), v[0][0].name) for topic, v in seen.items()} == {
        "/log/scan": (40, "foxglove.LaserScan"),
        "/prior/pose": (40, "foxglove.PoseInFrame"),
        "/localizer/pose": (40, "foxglove.PoseInFrame"),
        "/tf": (80, "foxglove.FrameTransform"),
    }
    _, _, message, scan = seen["/log/scan"][3]
    assert (message.log_time, message.publish_time, message.sequence) == (
        10**18 + 3 * 10**8,
        10**18 + 3 * 10**8 - 3,
        16,
    )
    assert scan.ranges[179] == 8.0
    assert {(t.parent_frame_id, t.child_frame_id) for _, _, _, t in seen["/tf"]} == {
        ("odom", "base"),
        ("map", "odom"),
    }


def test_log_times_never_fall(tmp_path):
    sink, _ = record(tmp_path)
    with sink.path.open("rb") as file:
        times = [m.log_time for _, _, m in make_reader(file).iter_messages(log_time_order=False)]
    assert times == sorted(times)


def test_what_was_given_is_read_back(tmp_path):
    sink, _ = record(tmp_path)
    log = Log(sink.path)
    found = list(log.messages())
    given = [item for i in range(40) for item in step(i)]
    assert [(s, m.type_name, m.seq, m.time, m.stamp) for s, m in found] == [
        (s, m.type_name, m.seq, m.time, m.stamp) for s, m in given
    ]
    np.testing.assert_array_equal(found[6][1].ranges, given[6][1].ranges)
    assert log.run == RUN
    figures = sink.statistics()
    assert figures == {"records": 40 * 10, "dropped": 0, "bytes": sink.path.stat().st_size}


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_config_of_compression_and_views(tmp_path, compression):
    sink, _ = record(tmp_path, compression=compression, level=1, views=False, path="sub/x.mcap")
    assert sink.path == tmp_path / "sub" / "x.mcap"
    assert topics(sink.path) == {}
    assert len(list(Log(sink.path).messages())) == 200
    with sink.path.open("rb") as file:
        used = {index.compression for index in make_reader(file).get_summary().chunk_indexes}
    assert used == {"" if compression == "none" else compression}


def test_include_and_exclude(tmp_path):
    sink, _ = record(tmp_path, include=("log.*", "*.pose"), exclude=("prior.*",))
    assert {s for s, _ in Log(sink.path).messages()} == {"log.odometry", "log.scan", "localizer.pose"}
    assert topics(sink.path).keys() == {"/log/scan", "/localizer/pose", "/tf"}


def test_two_identical_runs_have_one_digest(tmp_path):
    paths = []
    for name, ms in (("a", 1.0), ("b", 2.0)):
        (tmp_path / name).mkdir()
        extra = [("runtime.statistics", Statistics(stamp=1, time=10**19 // 2, seq=9, data={"ms": ms}))]
        paths.append(record(tmp_path / name, extra=extra)[0].path)
    assert digest(paths[0]) == digest(paths[1])
    log = Log(paths[0])
    log.scan()
    assert {c.topic for c in log.channels.values() if c.wall_clock} == {
        "/knotwork/runtime/statistics",
        "/runtime/statistics",
    }


def test_a_frame_has_one_parent(tmp_path):
    """Without odometry the estimate places the robot; with it, the estimate does not."""
    context = FakeContext(tmp_path)
    sink = McapRecorder(context)
    sink.open()
    for i in range(3):
        for stream, message in step(i):
            if stream != "log.odometry":
                sink.on_message(stream, message)
        sink.on_message("other.odometry", step(i)[0][1])
    sink.close()
    tf = {(t.parent_frame_id, t.child_frame_id) for _, _, _, t in topics(sink.path)["/tf"]}
    assert tf == {("map", "base"), ("map", "odom")}


def test_early_stamps_and_unset_times_fit_the_format(tmp_path):
    sink, _ = record(tmp_path, n=0, extra=[("a.event", Event(stamp=-5, node="n", level="info", text="t"))])
    ((_, found),) = Log(sink.path).messages()
    assert (found.stamp, found.time, found.seq) == (-5, -1, -1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Custom(Message):
    type_name: ClassVar[str] = "custom"
    values: list[int] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unfit(Message):
    type_name: ClassVar[str] = "unfit"
    value: complex = 0j


def test_third_party_type_and_unfit_type(tmp_path, monkeypatch):
    monkeypatch.setattr(message_types, "_TYPES", {"custom": f"{__name__}:Custom"})
    monkeypatch.setitem(sys.modules, __name__, SimpleNamespace(Custom=Custom))
    extra = [
        ("a.custom", Custom(stamp=1, values=[1, 2])),
        ("a.unfit", Unfit(stamp=1)),
        ("a.unfit", Unfit(stamp=2)),
    ]
    extra += [("a.statistics", Statistics(stamp=1, data={"x": object()}))]
    sink, context = record(tmp_path, n=0, extra=extra)
    ((stream, found),) = Log(sink.path).messages()
    assert (stream, found.values) == ("a.custom", [1, 2])
    assert [level for level, _ in context.reports] == ["error", "error"]
    assert "a.unfit is not fully recorded" in context.reports[0][1]
    assert "Unfit.value has type complex" in context.reports[0][1]


def test_unwritable_folder_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    sink = McapRecorder(FakeContext(tmp_path, path="file/log.mcap"))
    with pytest.raises(KnotworkError, match=r"log\.mcap: cannot write the log: .*free some space"):
        sink.open()
    sink.close()


def test_flushed_without_further_messages(tmp_path):
    """The second thread writes the last messages although none follows them."""
    sink = McapRecorder(FakeContext(tmp_path, flush=0.02, fsync=0.02))
    sink.open()
    for stream, message in step(0):
        sink.on_message(stream, message)
    deadline = time.monotonic() + 20
    while len(list(Log(sink.path).messages())) < 5 and time.monotonic() < deadline:
        time.sleep(0.02)
    assert len(list(Log(sink.path).messages())) == 5
    sink.close()


CHILD = """
import os, sys, time
from pathlib import Path
sys.path.insert(0, {folder!r})
from test_mcap import FakeContext, McapRecorder, step
sink = McapRecorder(FakeContext(Path(sys.argv[1]), flush=0.05, fsync=0.1))
sink.open()
i = 0
while True:
    for stream, message in step(i):
        sink.on_message(stream, message)
    i += 1
    print(i, flush=True)
    time.sleep(0.002)
"""


def test_kill_9_then_recover(tmp_path):
    code = CHILD.format(folder=os.path.dirname(__file__))
    child = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    for line in child.stdout:
        if int(line) >= 150:
            break
    time.sleep(0.3)  # more than a flush period: what was given before is in the file by now
    child.send_signal(signal.SIGKILL)
    child.wait()
    child.stdout.close()
    path = tmp_path / "log.mcap"
    with path.open("rb") as file, pytest.raises((McapError, struct.error)):
        list(make_reader(file).iter_messages())
    done = recover(path)
    assert not done.damage.complete
    found = [m for s, m in Log(done.path).messages() if s == "log.scan"]
    assert len(found) >= 150
    assert [m.scan_id for m in found] == list(range(len(found)))
    assert topics(done.path)["/log/scan"]
    assert Log(done.path).run == {}  # nothing read yet
    log = Log(done.path)
    log.scan()
    assert log.run == RUN


def check_goes_on(sink, context, make_room):
    """Fill the disk, make room, go on; nothing that was written is lost, the rest is counted."""
    n = 0
    while not context.reports:
        for stream, message in step(n):
            sink.on_message(stream, message)
        n += 1
        assert n < 20000
    for _ in range(50):
        for stream, message in step(n):
            sink.on_message(stream, message)
        n += 1
    assert [level for level, _ in context.reports] == ["error"], context.reports
    make_room()
    while len(context.reports) < 2:
        for stream, message in step(n):
            sink.on_message(stream, message)
        n += 1
        assert n < 20000
    sink.close()
    assert [level for level, _ in context.reports] == ["error", "warning"]
    figures = sink.statistics()
    assert figures["dropped"] > 0
    assert figures["records"] + figures["dropped"] == n * 10
    with sink.path.open("rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == figures["records"]
    seqs = [m.seq for _, m in Log(sink.path).messages()]
    assert seqs == sorted(seqs)
    return context.reports


def test_full_disk_on_a_small_file_system(tmp_path):
    if os.geteuid() != 0:
        pytest.skip("mounting a small tmpfs needs root")
    small = tmp_path / "small"
    small.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(small)], capture_output=True)
    if mounted.returncode:
        pytest.skip(f"cannot mount: {mounted.stderr.decode().strip()}")
    try:
        context = FakeContext(small, chunk_size=4096, flush=60.0)
        sink = McapRecorder(context)
        sink.open()
        ballast = small / "ballast"
        ballast.write_bytes(bytes(150_000))
        reports = check_goes_on(sink, context, ballast.unlink)
        assert "No space left on device" in reports[0][1]
    finally:
        subprocess.run(["umount", "-l", str(small)], check=True)


def test_full_disk_by_the_process_limit(tmp_path):
    """The kernel refuses to let the file grow (EFBIG), which needs no root."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    context = FakeContext(tmp_path, chunk_size=4096, flush=60.0)
    sink = McapRecorder(context)
    sink.open()
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
    try:
        check_goes_on(sink, context, lambda: resource.setrlimit(resource.RLIMIT_FSIZE, before))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


class FullDisk:
    """A file on a disk that is full from some byte on."""

    def __init__(self, file, room):
        self.file, self.room = file, room

    def write(self, data):
        if self.file.tell() + len(data) > self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self.file.write(data)

    def __getattr__(self, name):
        return getattr(self.file, name)


def test_disk_that_stays_full(tmp_path, monkeypatch):
    monkeypatch.setattr(
        McapRecorder, "_create", staticmethod(lambda path: FullDisk(path.open("wb", buffering=0), 60_000))
    )
    sink, context = record(tmp_path, n=600, chunk_size=4096, flush=0.01)
    assert [level for level, _ in context.reports] == ["error", "error"]
    assert "No space left" in context.reports[0][1]
    assert "knotwork log recover" in context.reports[1][1]
    done = recover(sink.path)
    assert done.messages == sink.statistics()["records"]
    assert done.messages + sink.statistics()["dropped"] == 600 * 10


def test_disk_full_at_open_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(McapRecorder, "_create", staticmethod(lambda path: FullDisk(path.open("wb", buffering=0), 4)))
    sink = McapRecorder(FakeContext(tmp_path))
    with pytest.raises(KnotworkError, match="cannot write the log: No space left"):
        sink.open()
    sink.close()


def test_grid_view_is_on_its_own_topic(tmp_path):
    cells = np.zeros((4, 3), np.int8)
    sink, _ = record(tmp_path, n=0, extra=[("map.grid", Grid(stamp=1, cells=cells, resolution=0.1, origin=(0, 0, 0)))])
    assert topics(sink.path)["/map/grid"][0][3].column_count == 3


def test_manifest_is_light():
    code = (
        "import sys, knotwork.plugins.sinks.mcap, knotwork.plugins.sinks.map_image\n"
        "import knotwork.plugins.sinks.map_export, knotwork.plugins.commands.log\n"
        "import knotwork.core.message_types\n"
        "print(*{'numpy', 'mcap', 'PIL', 'google.protobuf'} & sys.modules.keys())"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == ""
    assert MANIFEST.inputs["all"].message == "*"
