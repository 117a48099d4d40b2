"""The picture shows what it was given where it should: pixels are asked by their metres."""

from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from knotwork.core.messages import Grid, Pose, Trajectory
from knotwork.plugins.sinks.map_image import MapImageConfig
from knotwork.plugins.sinks.map_image.drawing import _STRIP, _round_length, draw
from knotwork.plugins.sinks.map_image.image import MapImage

PATH, START, END = (214, 69, 33), (20, 133, 88), (31, 90, 180)


def room():
    """Return a grid of 4 m by 3 m at 5 cm: free, the left wall occupied, 1 m of unknown around."""
    cells = np.full((100, 120), -1, np.int8)
    cells[20:80, 20:100] = 0
    cells[20:80, 20:24] = 100
    return Grid(stamp=0, time=0, cells=cells, resolution=0.05, origin=(-2.0, -1.0, 0.0))


def picture(grid, path, size=800, margin=0.5):
    data = draw(grid, np.asarray(path, float).reshape(-1, 3), size=size, margin=margin)
    image = Image.open(BytesIO(data))
    image.load()
    return image


def at(image, x, y, *, left=-1.5, bottom=-0.5, width=5.0):
    """Return the pixel at a point [m]; the defaults are `room` with its margin."""
    scale = image.width / width
    return image.getpixel((int((x - left) * scale), image.height - _STRIP - 1 - int((y - bottom) * scale)))


def test_colours_of_cells():
    image = picture(room(), [])
    assert image.size[0] == 800
    assert at(image, 1.0, 1.0) == (255, 255, 255)
    assert at(image, -0.9, 1.0) == (0, 0, 0)
    assert at(image, -1.3, 1.0) == at(image, 3.3, 3.2) == (208, 208, 208)


def test_path_start_and_end():
    image = picture(room(), [[0, 0.5, 0], [1, 0.5, 0], [2, 1.5, 0.8]])
    assert at(image, 0.5, 0.5) == PATH
    assert at(image, 1.5, 1.0) == PATH
    assert at(image, 0.0, 0.5) == START
    assert at(image, 2.0, 1.5) == END
    assert at(image, 0.5, 1.5) == (255, 255, 255)
    colours = {colour for _, colour in image.getcolors(1 << 20)}
    assert len(colours) > 20  # edges are smooth


def test_scale_bar_is_as_long_as_it_says():
    image = picture(room(), [])
    row = [image.getpixel((x, image.height - _STRIP // 2)) for x in range(image.width // 2)]
    dark = [x for x, colour in enumerate(row) if colour == (40, 40, 40)]
    assert dark[0] == 14
    length = next(i for i, x in enumerate(dark) if i + 1 == len(dark) or dark[i + 1] != x + 1)
    assert length / (image.width / 5.0) == pytest.approx(1.0, abs=0.02)


@given(st.floats(1e-3, 1e5))
def test_round_length(length):
    found = _round_length(length)
    assert found <= length * (1 + 1e-9)
    assert found * 2.5000001 > length


def test_turned_grid_is_drawn_in_its_own_axes():
    grid = room()
    turned = Grid(stamp=0, cells=grid.cells, resolution=0.05, origin=(1.0, -2.0, np.pi / 2))
    # (1 + u, 1 + v) in the cells' axes of `turned` is (1 - (1 + v), -2 + 1 + u) on the map.
    image = picture(turned, [[-1.5, 1.0, 0.0], [-1.5, 1.5, 0.0]])
    assert at(image, 1.0, 1.5) == START
    assert at(image, 1.5, 1.5) == END


@pytest.mark.parametrize(
    "path", [[], [[np.nan, 0, 0]], [[1e12, 0, 0], [0, 0, 0]], [[0.5, 0.5, 0]], [[50, 0, 0], [0, 0, 0]]]
)
@pytest.mark.parametrize(
    "cells",
    [np.full((3, 3), -1, np.int8), np.zeros((0, 0), np.int8), np.zeros((1, 4000), np.int8), room().cells],
)
def test_no_grid_or_path_is_too_odd(cells, path):
    grid = Grid(stamp=0, cells=cells, resolution=0.05, origin=(0, 0, 0))
    image = picture(grid, path, size=300)
    assert 120 <= image.width <= 700
    assert image.height <= 700 + _STRIP


def run(out, messages, **config):
    context = SimpleNamespace(name="picture", config=MapImageConfig(**config), out=out, reports=[])
    context.report = lambda level, text: context.reports.append((level, text))
    sink = MapImage(context)
    for stream, message in messages:
        sink.on_message(stream, message)
    sink.close()
    return context


def pose(scan, x, y, **more):
    return Pose(stamp=scan, time=scan, **{"role": "estimate", "scan_id": scan, **more}, pose=np.array([x, y, 0.0]))


def test_estimates_are_drawn_and_a_trajectory_corrects_them(tmp_path):
    messages = [
        ("m.grid", room()),
        ("l.pose", pose(0, 0.0, 0.5)),
        ("l.pose", pose(1, 2.0, 0.5)),
        ("l.pose", pose(2, 2.5, 1.9, lost=True)),
        ("p.pose", pose(3, 2.6, 1.9, role="prior")),
    ]
    assert run(tmp_path, messages, size=800).reports == []
    with Image.open(tmp_path / "map.png") as image:
        assert at(image, 1.0, 0.5) == PATH
        assert at(image, 2.0, 0.5) == END
    corrected = Trajectory(
        stamp=9,
        scan_ids=np.array([1, 7]),
        stamps=np.array([1, 7]),
        poses=np.array([[0.0, 1.5, 0], [9, 9, 9]]),
        revision=1,
    )
    run(tmp_path, [*messages, ("l.trajectory", corrected)], size=800)
    with Image.open(tmp_path / "map.png") as image:
        assert at(image, 0.0, 1.0) == PATH
        assert at(image, 0.0, 1.5) == END
    run(tmp_path, messages, size=800, trajectory=False, name="bare")
    with Image.open(tmp_path / "bare.png") as image:
        assert at(image, 1.0, 0.5) == (255, 255, 255)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bare.png", "map.png"]


def test_period_and_further_streams(tmp_path):
    later = Grid(stamp=0, time=60 * 10**9, cells=room().cells, resolution=0.05, origin=(0, 0, 0))
    context = SimpleNamespace(name="p", config=MapImageConfig(period=60, size=200), out=tmp_path, report=pytest.fail)
    sink = MapImage(context)
    sink.on_message("m.grid", room())
    assert not list(tmp_path.iterdir())
    sink.on_message("m.grid", later)
    assert [path.name for path in tmp_path.iterdir()] == ["map.png"]
    sink.on_message("other.grid", later)
    sink.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map-other-grid.png", "map.png"]


def test_nothing_to_draw_is_said(tmp_path):
    assert run(tmp_path, []).reports == [("warning", "map.png is not drawn: no grid came")]
    ((level, text),) = run(tmp_path / "missing", [("m.grid", room())], size=200).reports
    assert level == "error"
    assert "map.png: cannot write" in text


def test_a_long_path_keeps_its_ends_and_its_shape(tmp_path):
    context = SimpleNamespace(out=tmp_path, config=MapImageConfig(), report=print)
    sink = MapImage(context)
    n = 30_000
    for i in range(n):
        where = np.array([3.0 * i / n, 1.0, 0.0])
        sink.on_message("a.pose", Pose(stamp=i, role="estimate", pose=where, scan_id=i if i % 3 else -1))
    kept = np.array(list(sink._path.values()))
    assert len(kept) <= 8192
    assert kept[0, 0] == 0.0
    assert kept[-1, 0] == 3.0 * (n - 1) / n
    assert (np.diff(kept[:, 0]) > 0).all()
    assert np.diff(kept[:, 0]).max() < 0.01
