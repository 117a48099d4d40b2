import numpy as np
import pytest

from knotwork.core.conformance import RecordingContext
from knotwork.core.map_file import write_map
from knotwork.core.messages import Scan
from knotwork.plugins.maps.spline_surface import MANIFEST
from knotwork.plugins.maps.spline_surface.map import SplineSurface


@pytest.fixture
def surface(tmp_path):
    def make(options=None, **config) -> SplineSurface:
        context = RecordingContext(MANIFEST, config, options=options, out=tmp_path)
        return SplineSurface(context)

    return make


def scan(ranges, angle_min=0.0, angle_increment=0.01, range_max=50.0):
    return Scan(
        stamp=0,
        scan_id=0,
        ranges=np.array(ranges, np.float32),
        angle_min=angle_min,
        angle_increment=angle_increment,
        range_min=0.05,
        range_max=range_max,
    )


def log_odds(chart, points):
    return 2 * np.arctanh(chart.occupancy(np.array(points, float)))


def raised(chart, beams=400):
    """Let beams of one scan end 0.5 m apart, each on untouched ground; return what they raised the surface by."""
    ranges = 2.0 + 0.5 * np.arange(beams)
    chart.update(scan(ranges, angle_increment=0.0, range_max=1000.0), np.array([0.11, -0.07, 0.3]))
    ends = np.array([0.11, -0.07]) + ranges[:, None] * [np.cos(0.3), np.sin(0.3)]
    return log_odds(chart, ends)


def test_one_hit_raises_the_surface_by_hit_where_the_beam_ended(surface):
    """(7.14) is the smallest change of control points that does so; each of those is rounded to a whole unit."""
    chart = surface(hit=1.3, free=0.0, resolution=[0.2, 0.05], range_max=300.0)
    found = raised(chart)
    assert np.abs(found - 1.3).max() < chart.unit
    assert found.mean() == pytest.approx(1.3, rel=1e-3)


def test_changes_much_smaller_than_a_unit_add_up(surface):
    """Against float32 control points, which a map has whose hits are smaller than a unit."""
    config = {"free": 0.004, "resolution": [0.2, 0.05]}
    whole, real = surface(hit=1.0, **config), surface(hit=0.05, **config)
    assert whole.surfaces[0].claimed()[1].dtype == np.int8
    assert real.surfaces[0].claimed()[1].dtype == np.float32
    assert config["free"] < whole.unit / 15
    for number in range(300):  # the walls are far from where the surface is read
        beams = scan(np.full(60, 9.0), angle_min=-0.3)
        for chart in (whole, real):
            chart.update(beams, np.array([0.001 * number, 0.0, 0.0]))
    x, y = np.meshgrid(np.linspace(1.0, 6.0, 60), np.linspace(-0.3, 0.3, 20))
    places = np.column_stack([x.ravel(), y.ravel()])
    found, true = log_odds(whole, places), log_odds(real, places)
    assert true.mean() < -0.1
    assert found.mean() == pytest.approx(true.mean(), rel=0.02)
    assert np.sqrt(np.mean((found - true) ** 2)) < 2.0 * whole.unit


def test_hits_add_up_until_the_clamp(surface):
    chart = surface(hit=1.0, free=0.0, clamp=8.0)
    for _ in range(3):
        chart.update(scan([2.0]), np.zeros(3))
    assert log_odds(chart, [[2.0, 0.0]]) == pytest.approx([3.0], abs=chart.unit)
    for _ in range(200):
        chart.update(scan([2.0]), np.zeros(3))
    # each control point is clamped, so the surface never exceeds the clamp
    near = np.stack(np.meshgrid(np.linspace(1.9, 2.1, 41), np.linspace(-0.1, 0.1, 41)), -1).reshape(-1, 2)
    assert log_odds(chart, near).max() <= 8.0 + 1e-4
    assert log_odds(chart, [[2.0, 0.0]])[0] > 7.8


def test_a_beam_clears_its_way_and_leaves_the_wall(surface):
    chart = surface(hit=1.0, free=0.2)
    for _ in range(20):
        chart.update(scan(np.full(60, 2.0), angle_min=-0.3), np.zeros(3))
    assert chart.occupancy(np.array([[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])) == pytest.approx([-1, 1, 0], abs=0.3)


@pytest.mark.parametrize("step", [0.05, 0.3])
def test_free_space_takes_nothing_from_the_wall(surface, step):
    """Samples stop three knots before it, where two cubic bases have 1 / 2416 of their square in common."""
    for reach in np.linspace(2.0, 2.9, 19):
        chart = surface(hit=1e-6, free=1.0, resolution=[step])
        chart.update(scan([reach]), np.zeros(3))
        assert log_odds(chart, [[1.0, 0.0]])[0] < -0.1
        assert log_odds(chart, [[reach, 0.0]])[0] > -0.005


def test_walls_alone_say_nothing_of_the_way_along_them(surface):
    """Two parallel walls: the information along them is a small share of that across."""
    angles = np.deg2rad(np.arange(360.0))
    with np.errstate(divide="ignore"):
        ranges = 0.8 / np.abs(np.sin(angles))
    ranges[ranges > 3.5] = np.inf
    corridor = scan(ranges, angle_increment=np.deg2rad(1.0), range_max=3.5)

    def share(**options) -> float:
        chart = surface(options=options)
        for x in np.arange(0.0, 2.0, 0.05):
            chart.update(corridor, np.array([x, 0.0, 0.0]))
        pose = np.array([2.0, 0.0, 0.0])
        H = chart.alignment(corridor, pose).normal_equations(pose, 3).H
        return float(H[0, 0] / H[1, 1])

    assert share() < 0.01
    assert share() < 0.2 * share(normals=False)


def test_memory_follows_the_explored_area(surface):
    """A way twice as long takes twice the memory, not four times: no bounding box is paid for."""
    room = scan(np.full(360, 1.5), angle_increment=np.deg2rad(1.0))
    sizes = []
    for length in (40.0, 80.0):
        chart = surface()
        for d in np.arange(0.0, length, 0.5):
            chart.update(room, np.array([d * 0.7071, d * 0.7071, 0.0]))  # diagonally
        sizes.append(chart.nbytes)
    assert 1.6 < sizes[1] / sizes[0] < 2.4


def test_a_file_of_float_control_points_is_read(surface, tmp_path):
    """Maps were saved so before control points took one byte: version 1."""
    chart = surface(clamp=8.0)
    for _ in range(5):
        chart.update(scan(np.linspace(2.0, 3.0, 60), angle_min=-0.3), np.zeros(3))
    facts, arrays = chart.stored()
    old = {name: a * np.float32(chart.unit) if name.startswith("tiles") else a for name, a in arrays.items()}
    path = tmp_path / "old.map"
    write_map(path, "spline-surface", 1, facts | {"config": {}}, old)
    again, finer = surface(clamp=8.0), surface(clamp=8.0, hit=0.01)
    again.load(path)
    chart.save(tmp_path / "new.map")
    finer.load(tmp_path / "new.map")
    for level, tiles in enumerate(again.surfaces):
        whole = chart.surfaces[level].claimed()[1]
        np.testing.assert_array_equal(tiles.claimed()[1], whole)
        np.testing.assert_allclose(finer.surfaces[level].claimed()[1], whole * chart.unit, rtol=1e-6)
