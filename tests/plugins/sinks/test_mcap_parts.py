"""A recording in several files, also when the disk is full at the wrong moment."""

import errno
from types import SimpleNamespace

import pytest

from knotwork.core.log.check import check
from knotwork.core.log.reader import Log
from knotwork.core.messages import Image, Twist
from knotwork.plugins.sinks.mcap import McapConfig
from knotwork.plugins.sinks.mcap.recorder import McapRecorder

SECOND = 10**9


def recorder(out, **config):
    context = SimpleNamespace(
        name="recorder", config=McapConfig(**config), out=out, run={"pipeline": "p"}, reports=[], counts={}
    )  # fmt: skip
    context.report = lambda level, text: context.reports.append((level, text))
    context.count = lambda name, by=1: context.counts.update({name: context.counts.get(name, 0) + by})
    sink = McapRecorder(context)
    sink.open()
    return sink, context


def give(sink, seconds):
    for i, second in enumerate(seconds):
        at = round(second * SECOND)
        sink.on_message("drive.twist", Twist(stamp=at, vx=second).sealed(at, i))


def stamps(path):
    return [m.stamp / SECOND for _, m in Log(path).messages()]


def test_by_time(tmp_path):
    sink, context = recorder(tmp_path, split_time=10)
    give(sink, [100, 104, 109.9, 110, 115, 131, 132])
    sink.close()
    paths = sorted(tmp_path.glob("log.*.mcap"))
    assert [path.name for path in paths] == ["log.0000.mcap", "log.0001.mcap", "log.0002.mcap"]
    assert [stamps(path) for path in paths] == [[100, 104, 109.9], [110, 115], [131, 132]]
    for number, path in enumerate(paths):
        assert check(path).problems == []
        log = Log(path)
        log.overview()
        assert log.run == {"pipeline": "p", "part": number}
    assert context.reports == []
    figures = sink.statistics()
    assert figures["bytes"] == sum(path.stat().st_size for path in paths)
    assert figures["dropped"] == 0


def test_by_size(tmp_path):
    sink, _ = recorder(tmp_path, split_size=20_000, chunk_size=2048, compression="none", views=False)
    for i in range(100):
        image = Image(stamp=i, data=bytes(1000), encoding="mono8", width=10, height=100)
        sink.on_message("camera.image", image.sealed(i, i))
    sink.close()
    paths = sorted(tmp_path.glob("log.*.mcap"))
    assert len(paths) > 3
    assert all(20_000 <= path.stat().st_size < 30_000 for path in paths[:-1])
    assert [round(s * SECOND) for path in paths for s in stamps(path)] == list(range(100))


def test_a_part_that_cannot_be_begun_leaves_the_old_one_going(tmp_path, monkeypatch):
    sink, context = recorder(tmp_path, split_time=10)
    give(sink, [0, 5])
    real = McapRecorder._create

    def full(path):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(McapRecorder, "_create", staticmethod(full))
    give(sink, [11, 12])
    monkeypatch.setattr(McapRecorder, "_create", staticmethod(real))
    give(sink, [25, 26])
    sink.close()
    assert stamps(tmp_path / "log.0000.mcap") == [0, 5, 11, 12]
    assert stamps(tmp_path / "log.0001.mcap") == [25, 26]
    assert context.counts == {"failed_splits": 1}
    (text,) = (text for _, text in context.reports)
    assert text.endswith("log.0001.mcap: cannot be begun: No space left on device; log.0000.mcap goes on")


@pytest.mark.parametrize("config", [{}, {"split_time": 0, "split_size": 0}])
def test_one_file_unless_asked(tmp_path, config):
    sink, _ = recorder(tmp_path, **config)
    give(sink, [0, 10_000])
    sink.close()
    assert [path.name for path in tmp_path.iterdir()] == ["log.mcap"]
