"""`map.pgm` and `map.yaml` read back by map_server's rules and by Pillow."""

from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image
from pydantic import ValidationError

from knotwork.core.messages import Grid, Twist
from knotwork.plugins.sinks.map_export import MapExportConfig
from knotwork.plugins.sinks.map_export.export import MapExport, map_yaml, pgm


def context(out, **config):
    found = SimpleNamespace(name="export", config=MapExportConfig(**config), out=out, reports=[])
    found.report = lambda level, text: found.reports.append((level, text))
    return found


def grid(cells, time=0, **more):
    return Grid(
        stamp=time,
        time=time,
        cells=np.asarray(cells, np.int8),
        **{"resolution": 0.05, "origin": (0.0, 0.0, 0.0), **more},
    )


def map_server(folder, name="map"):
    """Read a map as ROS map_server (trinary) does; return cells as in an OccupancyGrid, and the origin."""
    facts = yaml.safe_load((folder / f"{name}.yaml").read_text())
    assert facts["mode"] == "trinary"
    assert facts["negate"] == 0
    with Image.open(folder / facts["image"]) as image:
        assert (image.format, image.mode) == ("PPM", "L")
        pixels = np.asarray(image)
    occupied, free = np.float32(facts["occupied_thresh"]), np.float32(facts["free_thresh"])
    cells = np.full(pixels.shape, -1)
    for row in range(pixels.shape[0]):
        for column in range(pixels.shape[1]):
            occ = np.float32((255 - int(pixels[row, column])) / 255.0)
            if occ > occupied:
                cells[pixels.shape[0] - row - 1, column] = 100
            elif occ < free:
                cells[pixels.shape[0] - row - 1, column] = 0
    return cells, facts


def trinary(cells, free=0.196, occupied=0.65):
    out = np.full(cells.shape, -1)
    out[(cells >= 0) & (cells < 100 * free)] = 0
    out[cells > 100 * occupied] = 100
    return out


def export(out, grids, **config):
    found = context(out, **config)
    sink = MapExport(found)
    for stream, message in grids:
        sink.on_message(stream, message)
    sink.close()
    return found


def test_map_server_reads_the_cells_back(tmp_path):
    cells = np.random.default_rng(0).integers(-1, 101, (7, 11)).astype(np.int8)
    export(tmp_path, [("map.grid", grid(cells, resolution=0.05, origin=(-12.5, 1e-5, 0.25)))])
    read, facts = map_server(tmp_path)
    np.testing.assert_array_equal(read, trinary(cells))
    assert facts["resolution"] == 0.05
    assert facts["origin"] == [-12.5, 1e-5, 0.25]
    assert facts["image"] == "map.pgm"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.pgm", "map.yaml"]


def test_lowest_y_is_the_last_row(tmp_path):
    export(tmp_path, [("map.grid", grid([[100, -1], [0, -1], [0, 0]]))])
    with Image.open(tmp_path / "map.pgm") as image:
        assert np.asarray(image).tolist() == [[254, 254], [254, 205], [0, 205]]


@given(
    hnp.arrays(np.int8, hnp.array_shapes(min_dims=2, max_dims=2, max_side=6), elements=st.integers(-1, 100)),
    st.floats(0.01, 0.9),
    st.floats(0.02, 0.9),
)
def test_any_thresholds(tmp_path_factory, cells, free, gap):
    occupied = min(free + gap, 0.99)
    folder = tmp_path_factory.getbasetemp()
    (folder / "h.pgm").write_bytes(pgm(cells, free, occupied))
    (folder / "h.yaml").write_text(map_yaml(grid(cells), "h.pgm", free, occupied))
    read, _ = map_server(folder, "h")
    np.testing.assert_array_equal(read, trinary(cells, free, occupied))


def test_last_grid_wins_and_each_stream_has_its_files(tmp_path):
    export(
        tmp_path,
        [
            ("a.grid", grid([[0]])),
            ("b.grid", grid([[100]])),
            ("a.grid", grid([[100, 0]])),
            ("b.twist", Twist(stamp=0, vx=1)),
        ],
    )
    assert map_server(tmp_path)[0].tolist() == [[100, 0]]
    assert map_server(tmp_path, "map-b-grid")[0].tolist() == [[100]]


def test_period_counts_log_time(tmp_path):
    found = context(tmp_path, period=10.0)
    sink = MapExport(found)
    for second in (0, 5, 9):
        sink.on_message("a.grid", grid([[0]], time=second * 10**9))
    assert not list(tmp_path.iterdir())
    sink.on_message("a.grid", grid([[100]], time=10 * 10**9))
    assert map_server(tmp_path)[0].tolist() == [[100]]


def test_no_grid_and_no_room_are_reported(tmp_path):
    assert export(tmp_path, []).reports == [("warning", "map.pgm is not written: no grid came")]
    found = export(tmp_path / "missing", [("a.grid", grid([[0]]))])
    assert found.reports[0][0] == "error"
    assert "map.pgm: cannot write" in found.reports[0][1]


def test_thresholds_must_leave_room_for_unknown():
    with pytest.raises(ValidationError, match="unknown cells lie between"):
        MapExportConfig(free_thresh=0.65)
