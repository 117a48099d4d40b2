import math

import numpy as np
import pytest

from knotwork.core.cells.traversal import cells_along
from knotwork.core.conformance import RecordingContext
from knotwork.core.messages import Scan
from knotwork.plugins.maps.grid import MANIFEST, GridConfig
from knotwork.plugins.maps.grid.map import GridMap, storage


@pytest.fixture
def grid(tmp_path):
    def make(options=None, **config) -> GridMap:
        return GridMap(RecordingContext(MANIFEST, config, options=options, out=tmp_path))

    return make


def scan(ranges, angle_min=0.0, angle_increment=0.01, range_max=50.0):
    return Scan(
        stamp=0, scan_id=0, ranges=np.array(ranges, np.float32), angle_min=angle_min,
        angle_increment=angle_increment, range_min=0.05, range_max=range_max,
    )  # fmt: skip


def log_odds(chart):
    i0, j0, i1, j1 = chart.cells[-1].bounds()
    return chart.cells[-1].block(i0, j0, i1, j1) * chart.quantum, i0, j0


def test_a_cell_is_one_byte_where_the_sensor_model_fits_and_two_where_it_does_not():
    for keys, expected in (({}, np.int8), ({"clamp": 25.0, "free": 0.1}, np.int16), ({"free": 0.0}, np.int8)):
        config = GridConfig(**keys)
        dtype, quantum = storage(config)
        assert dtype is expected
        limit = np.iinfo(dtype).max
        for value in (config.hit, config.free, config.clamp):
            assert round(value / quantum) <= limit
            assert round(value / quantum) * quantum == pytest.approx(value, rel=0.1, abs=quantum / 2)
        if config.free:  # free is what is added most often: exact
            assert round(config.free / quantum) * quantum == pytest.approx(config.free, rel=1e-9)


def test_memory_is_one_byte_a_cell_of_the_tiles_that_were_seen(grid):
    chart = grid(resolution=[0.05])
    chart.update(scan([3.0]), np.zeros(3))
    cells = chart.cells[0]
    assert cells.pool.itemsize == 1
    assert len(cells.claimed()[0]) == 1  # 3 m of beam lie in one tile of 3.2 m
    assert chart.nbytes <= 6 * 64 * 64 + cells.directory.nbytes


def test_a_beam_frees_the_cells_it_crosses_and_raises_the_one_it_ends_in(grid):
    chart = grid(resolution=[0.1], hit=1.0, free=0.2, options={"margin": 0.0})
    pose = np.array([0.33, -0.21, 0.4])
    chart.update(scan([4.0]), pose)
    values, i0, j0 = log_odds(chart)
    ux, uy = math.cos(0.4), math.sin(0.4)
    expected = np.zeros_like(values)
    for i, j in cells_along(0.33, -0.21, ux, uy, 0.05, np.float32(4.0), 0.1):
        expected[i - i0, j - j0] = -0.2
    expected[math.floor((0.33 + 4 * ux) / 0.1) - i0, math.floor((-0.21 + 4 * uy) / 0.1) - j0] = 1.0
    assert values == pytest.approx(expected, abs=1e-6)


def test_a_cell_changes_once_a_scan_and_a_hit_wins(grid):
    """Many beams through the same cells count once; a beam that passes a cell where another ended does not free it."""
    chart = grid(resolution=[0.1], hit=1.0, free=0.2, options={"margin": 0.0})
    chart.update(scan([2.1] * 5 + [3.0] * 5, angle_increment=1e-4), np.array([0.05, 0.05, 0.0]))
    values, i0, j0 = log_odds(chart)
    row = values[:, 0 - j0]
    assert row[21 - i0] == pytest.approx(1.0)
    assert row[10 - i0] == pytest.approx(-0.2)
    assert row[25 - i0] == pytest.approx(-0.2)


def test_log_odds_stop_at_the_clamp(grid):
    chart = grid(resolution=[0.1], clamp=4.0)
    for _ in range(100):
        chart.update(scan([2.05]), np.array([0.0, 0.05, 0.0]))
    values, _, _ = log_odds(chart)
    assert values.max() == pytest.approx(4.0)
    assert values.min() == pytest.approx(-4.0)


def test_it_grows_in_every_direction_and_keeps_what_it_knew(grid):
    chart = grid(resolution=[0.1])
    poses = [np.array([x, y, 0.0]) for x, y in ((0, 0), (300, 0), (-200, 50), (0, -400))]
    ends = np.array([[p[0] + 2.05, p[1] + 0.05] for p in poses])
    for pose in poses:
        chart.update(scan([2.05]), pose + np.array([0, 0.05, 0]))
    assert np.all(chart.occupancy(ends) > 0.4)
    assert chart.nbytes < 30 * 64 * 64 + chart.cells[0].directory.nbytes


def test_a_file_of_another_quantum_is_read_to_half_a_quantum(grid, tmp_path):
    fine = grid(resolution=[0.1], free=0.04)
    for k in range(30):
        fine.update(scan(np.full(300, 2.0), angle_increment=0.02), np.array([0.05 * k, 0.0, 0.0]))
    fine.save(tmp_path / "fine.map")
    coarse = grid(resolution=[0.1], free=0.1)
    coarse.load(tmp_path / "fine.map")
    assert coarse.quantum != fine.quantum
    assert log_odds(coarse)[0] == pytest.approx(log_odds(fine)[0], abs=0.51 * coarse.quantum)
