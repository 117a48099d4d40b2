import json
import math

import numpy as np
import pytest

from knotwork.core.errors import KnotworkError
from knotwork.core.messages import Event, Grid, Odometry, Pose, Scan, Statistics
from knotwork.plugins.sinks.summary import SummaryConfig
from knotwork.plugins.sinks.summary.writer import SummaryWriter

S = 1_000_000_000


class SinkContext:
    def __init__(self, out, **config):
        self.out = out
        self.config = SummaryConfig(**config)
        self.run = {"pipeline": "test"}


def scan(i):
    return Scan(
        stamp=0,
        scan_id=i,
        ranges=np.zeros(2, np.float32),
        angle_min=0.0,
        angle_increment=0.1,
        range_min=0.0,
        range_max=1.0,
    ).sealed((100 + i) * S, i)


def pose(i, x, y, **more):
    message = Pose(stamp=0, pose=np.array([x, y, 0.0]), scan_id=i, **({"role": "estimate"} | more))
    return message.sealed((100 + i) * S, i)


def grid(stream_bytes):
    return Grid(
        stamp=0,
        cells=np.zeros((1, 1), np.int8),
        resolution=0.05,
        origin=(0.0, 0.0, 0.0),
        map_bytes=stream_bytes,
    ).sealed(101 * S, 0)


def statistics(final=True, **data):
    return Statistics(stamp=0, data=data, final=final).sealed(10**6 * S, 0)


def read(tmp_path, name="summary"):
    return json.loads((tmp_path / f"{name}.json").read_text())


NODES = {
    "log": {"n": 10, "mean_ms": 0.1, "p95_ms": 0.2, "max_ms": 0.5, "drops": 0},
    "map": {"n": 5, "mean_ms": np.float64(1.5), "p95_ms": 2.0, "max_ms": math.nan, "drops": np.int64(3)},
}


def test_summary_of_a_run(tmp_path):
    sink = SummaryWriter(SinkContext(tmp_path))
    sink.on_message("run.events", Event(stamp=0, node="log", level="info", text="begin").sealed(0, 0))
    for i, (x, y) in enumerate([(0, 0), (3, 4), (3, 5), (50, 50), (3, 6)]):
        sink.on_message("log.scan", scan(i))
        sink.on_message("prior.prior", pose(i, 99.0 * i, 0, role="prior"))
        sink.on_message("localizer.pose", pose(i, x, y, lost=i == 3))
        sink.on_message("other.pose", pose(i, -x, y))
    sink.on_message("map.grid", grid(1000))
    sink.on_message("map.grid", grid(5000))
    sink.on_message("log.odometry", Odometry(stamp=0, pose=np.zeros(3)).sealed(110 * S, 0))
    sink.on_message(
        "run.statistics",
        statistics(wall_s=0.5, startup_s=1.5, peak_rss_mb=99.0, nodes=NODES, counters={"log": {"malformed_lines": 2}}),
    )
    sink.close()
    assert read(tmp_path) == {
        "pipeline": "test",
        "complete": True,
        "scans": 5,
        "log_duration_s": 10.0,
        "wall_s": 0.5,
        "real_time_factor": 20.0,
        "path_length_m": 7.0,
        "lost_scans": 1,
        "truth": None,
        "startup_s": 1.5,
        "peak_rss_mb": 99.0,
        "map_bytes": 5000,
        "drops": 3,
        "nodes": NODES | {"map": NODES["map"] | {"max_ms": None}},
        "counters": {"log": {"malformed_lines": 2}},
    }
    assert [p.name for p in tmp_path.iterdir()] == ["summary.json"]


def test_it_is_written_every_period_of_the_log_and_says_that_it_is_not_complete(tmp_path):
    sink = SummaryWriter(SinkContext(tmp_path, period=3.0, name="sum"))
    seen = []
    for i in range(8):
        sink.on_message("log.scan", scan(i))
        seen.append(read(tmp_path, "sum")["scans"] if (tmp_path / "sum.json").exists() else 0)
    assert seen == [0, 0, 0, 4, 4, 4, 7, 7]
    assert read(tmp_path, "sum")["complete"] is False
    sink.on_message("run.statistics", statistics(final=False, wall_s=2.0, nodes=NODES))
    sink.close()
    got = read(tmp_path, "sum")
    assert (got["scans"], got["complete"], got["real_time_factor"]) == (8, False, 3.5)


def test_a_run_without_messages_still_has_a_summary(tmp_path):
    sink = SummaryWriter(SinkContext(tmp_path))
    sink.close()
    got = read(tmp_path)
    assert (got["scans"], got["log_duration_s"], got["real_time_factor"]) == (0, 0.0, None)


def test_the_summary_of_before_stays_when_the_new_one_cannot_be_written(tmp_path):
    sink = SummaryWriter(SinkContext(tmp_path))
    sink.on_message("run.statistics", statistics(wall_s=1.0, nodes=NODES))
    before = (tmp_path / "summary.json").read_bytes()
    (tmp_path / ".summary.json.partial").mkdir()  # stands in the way of the new file
    with pytest.raises(KnotworkError, match=r"summary.json: cannot write"):
        sink.on_message("run.statistics", statistics(wall_s=2.0, nodes=NODES))
    assert (tmp_path / "summary.json").read_bytes() == before


def test_estimates_are_compared_with_the_truth_in_the_frame_of_the_first_true_pose(tmp_path):
    sink = SummaryWriter(SinkContext(tmp_path))
    # The robot starts at (10, 5), heading along y, and drives 2 m ahead; the estimate is 3 cm and 4 cm off.
    true = [(10.0, 5.0, math.pi / 2), (10.0, 6.0, math.pi / 2), (10.0, 7.0, math.pi / 2)]
    estimates = [(0.0, 0.0, 0.0), (1.03, 0.0, 0.0), (2.0, -0.04, math.radians(3.0))]
    for i, (t, e) in enumerate(zip(true, estimates, strict=True)):
        stamps = {"stamp": 0, "scan_id": i}
        sink.on_message("localizer.pose", Pose(role="estimate", pose=np.array(e), **stamps).sealed(i * S, i))
        sink.on_message("sim.truth", Pose(role="truth", pose=np.array(t), **stamps).sealed(i * S, i))
    sink.close()
    truth = read(tmp_path)["truth"]
    assert truth["n"] == 3
    # the first estimate came before the first truth: it waits for it, like the others
    assert truth["position_rms_m"] == pytest.approx(math.sqrt((0.03**2 + 0.04**2) / 3))
    assert truth["position_max_m"] == pytest.approx(0.04)
    assert truth["heading_rms_deg"] == pytest.approx(3.0 / math.sqrt(3))
