import base64
import math
import re
from html.parser import HTMLParser
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from knotwork.core.messages import Event, Grid, Pose, Scan, Statistics, Trajectory
from knotwork.plugins.sinks.report import MANIFEST
from knotwork.plugins.sinks.report.sink import Report

SECOND = 1_000_000_000
VOID = {"meta", "br", "image", "rect", "path", "polyline", "circle", "!doctype"}


class Checked(HTMLParser):
    """Fails on tags that do not close and on anything that is not within the file."""

    def __init__(self, text):
        super().__init__()
        self.open = []
        self.addresses = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.addresses += [value for name, value in attributes if name in ("src", "href", "action")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag


@pytest.fixture
def report(knotwork_context):
    def run(messages, **config):
        context = knotwork_context(MANIFEST, config)
        context.run |= {"config": "nodes: {a: <b>}\n", "versions": {"numpy": "9.9"}, "plugins": {"map": "grid (x 1)"}}
        node = Report(context)
        node.open()
        for number, (stream, message) in enumerate(messages):
            node.on_message(stream, message.sealed(max(message.stamp, 0), number))
        node.finish()
        node.close()
        text = (context.out / "report.html").read_text()
        return Checked(text), text, context

    return run


def truth(scan, x, y, yaw=0.0):
    return "sim.truth", Pose(stamp=scan * SECOND, role="truth", pose=np.array([x, y, yaw]), scan_id=scan)


def estimate(scan, x, y, yaw=0.0, **more):
    return "loc.pose", Pose(stamp=scan * SECOND, role="estimate", pose=np.array([x, y, yaw]), scan_id=scan, **more)


def cells(text, first):
    """The cells of the table row that begins with a text."""
    row = next(r for r in re.findall(r"<tr>(.*?)</tr>", text) if f"<td>{first}</td>" in r)
    return [re.sub("<.*?>", "", cell) for cell in re.findall(r"<td>(.*?)</td>", row)]


def final(**data):
    return "runtime.statistics", Statistics(stamp=9 * SECOND, data=data, final=True)


def test_one_file_that_needs_no_other(report):
    grid = Grid(stamp=0, cells=np.array([[0, 100], [-1, 50]], np.int8), resolution=0.5, origin=(1, 2, 0.3))
    checked, text, context = report([("map.grid", grid), estimate(0, 1, 1), estimate(1, 2, 1), final()])
    assert all(address.startswith("data:") for address in checked.addresses)
    assert "<script" not in text
    assert "url(" not in text
    assert "nodes: {a: &lt;b&gt;}" in text
    assert "9.9" in text
    assert "grid (x 1)" in text
    assert not context.reports
    png = next(a for a in checked.addresses if a.startswith("data:image/png;base64,"))
    picture = np.asarray(Image.open(BytesIO(base64.b64decode(png.partition(",")[2]))).convert("RGBA"))
    assert picture[1, 0, 0] == 255  # free, the lowest row
    assert picture[1, 1, 0] < 60
    assert picture[0, 0, 3] == 0  # unknown


def test_errors_against_the_truth(report):
    """Truth begins at (5, 5) looking left: the map's frame is seen from there."""
    true = [truth(k, 5, 5 + k, math.pi / 2) for k in range(4)]
    ours = [estimate(k, k + 0.3, 0.4, 0.1) for k in range(4)]
    _, text, _ = report([*true, *ours, final()])
    assert cells(text, "loc.pose") == ["loc.pose", "4", "0.5000", "0.5000", "5.7296", "5.7296"]
    assert text.count('class="line"') == 2


def test_corrections_replace_what_was_estimated(report):
    ids = np.arange(4, dtype=np.int64)
    poses = np.column_stack([ids, 0 * ids, 0 * ids]).astype(float)
    closed = "loop.trajectory", Trajectory(stamp=5, scan_ids=ids, stamps=ids * SECOND, poses=poses)
    _, text, _ = report([*(truth(k, k, 0) for k in range(4)), *(estimate(k, k, 1) for k in range(4)), closed, final()])
    assert cells(text, "loc.pose")[2] == "0.0000"


def test_relations_and_reference(report, tmp_path):
    (tmp_path / "a.relations").write_text("0.0 2.0 2.0 0.1 0 0 0 0\n")
    (tmp_path / "b.tum").write_text("".join(f"{k} {k + 7} 3 0 0 0 0 1\n" for k in range(3)))
    files = {"relations": str(tmp_path / "a.relations"), "reference": str(tmp_path / "b.tum")}
    _, text, context = report([*(estimate(k, k, 0) for k in range(3)), final()], **files)
    assert cells(text, "all")[1:4] == ["1", "0", "0.1000 ± 0.0000"]
    assert cells(text, "absolute, aligned")[:3] == ["absolute, aligned", "3", "0.0000"]
    assert not context.reports


def test_a_wrong_file_is_said_and_the_rest_is_there(report, tmp_path):
    _, text, context = report([estimate(0, 0, 0), final()], relations=str(tmp_path / "absent"))
    assert [level for level, _ in context.reports] == ["error"]
    assert "absent" in context.reports[0][1]
    assert "absent" in text
    assert "Configuration" in text


def test_latencies(report):
    row = {"n": 7, "mean_ms": 1.0, "p50_ms": 1.0, "p95_ms": 2.0, "p99_ms": 3.0, "max_ms": 4.5, "drops": 3}
    data = {"nodes": {"loc": row}, "histograms": {"loc": [[1.0, 5], [4.8, 2]]}, "counters": {"loc": {"gaps": 2}}}
    _, text, _ = report([final(**data)])
    assert cells(text, "loc")[:8] == ["loc", "7", "1.000", "1.000", "2.000", "3.000", "4.500", "3"]
    assert text.count("<rect") == 2
    assert cells(text, "loc") is not None
    assert "gaps" in text


def test_a_run_that_broke_off_says_so(report):
    _, text, _ = report([estimate(0, 0, 0)])
    assert "did not end well" in text


def test_events_are_limited_but_counted(report):
    many = [("runtime.events", Event(stamp=k, node="n", level="warning", text=f"<{k}>")) for k in range(9)]
    _, text, _ = report([*many, ("runtime.events", Event(stamp=1, node="n", level="info", text="fine"))], events=4)
    assert "&lt;3&gt;" in text
    assert "&lt;4&gt;" not in text
    assert "(9)" in text
    assert "and 5 more" in text
    assert "fine" not in text


def test_two_localisers_and_two_maps(report):
    grid = Grid(stamp=0, cells=np.zeros((3, 3), np.int8), resolution=1.0, origin=(0, 0, 0))
    other = "two.pose", Pose(stamp=1, role="estimate", pose=np.zeros(3), scan_id=0)
    ranges = np.ones(3, np.float32)
    scan = Scan(stamp=1, scan_id=0, ranges=ranges, angle_min=0, angle_increment=1, range_min=0, range_max=9)
    _, text, _ = report([("a.grid", grid), ("b.grid", grid), estimate(0, 1, 1), other, ("l.scan", scan), final()])
    assert text.count('class="plane"') == 2
    assert text.count('class="key"') == 2
