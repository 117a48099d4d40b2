import json

import numpy as np
import pytest
from PIL import Image

from knotwork.core.cli.main import main
from knotwork.core.conformance import RecordingContext
from knotwork.core.conformance.room import Room
from knotwork.core.map_file import write_map
from knotwork.core.registry import Registry
from knotwork.plugins.commands.map.convert import open_map
from knotwork.plugins.commands.map.svg import svg

PLUGINS = ["spline-surface", "grid", "tsdf"]
RESOLUTION = [0.2, 0.1]


def save(plugin, folder, options=None):
    """A room, mapped by a plugin and saved."""
    registry = Registry(third_parties=False)
    manifest = registry.find(plugin)
    chart = registry.load(manifest)(RecordingContext(manifest, {"resolution": RESOLUTION}, options=options, out=folder))
    room = Room()
    for number, pose in enumerate(room.poses(12)):
        chart.update(room.scan(pose, scan_id=number), pose)
    chart.save(folder / "room.map")
    return chart, folder / "room.map"


@pytest.mark.parametrize("plugin", PLUGINS)
def test_any_map_becomes_files_for_navigation_stacks_and_a_picture(plugin, tmp_path, capsys):
    chart, file = save(plugin, tmp_path)
    assert main(["map", "convert", str(file), "--to", "pgm"]) == 0
    assert capsys.readouterr().out.split() == [str(tmp_path / "room.pgm"), str(tmp_path / "room.yaml")]
    cells, resolution, origin = chart.rasterize()
    header, size, _, pixels = (tmp_path / "room.pgm").read_bytes().split(b"\n", 3)
    grey = np.frombuffer(pixels, np.uint8).reshape(cells.shape)[::-1]
    assert header == b"P5"
    assert size.split() == [str(cells.shape[1]).encode(), str(cells.shape[0]).encode()]
    assert np.array_equal(grey == 0, cells > 65)
    assert np.array_equal(grey == 254, (cells >= 0) & (cells < 19.6))
    text = (tmp_path / "room.yaml").read_text()
    assert f"resolution: {resolution}" in text
    assert f"origin: [{origin[0]:.6g}" in text
    assert main(["map", "convert", str(file), "--to", "png", "--output", str(tmp_path / "other.png")]) == 0
    with Image.open(tmp_path / "other.png") as picture:
        colours = set(picture.convert("L").tobytes())
    assert {0, 255} <= colours or min(colours) < 60


def test_what_is_in_a_file(tmp_path, capsys):
    _, file = save("grid", tmp_path, options={"interpolation": "bicubic"})
    assert main(["map", "info", str(file)]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["plugin"] == "grid"
    assert facts["version"] == 1
    assert facts["resolution"] == RESOLUTION
    assert facts["options"]["interpolation"] == "bicubic"


def test_a_map_comes_back_in_the_configuration_that_it_was_made_with(tmp_path):
    chart, file = save("grid", tmp_path, options={"interpolation": "bicubic"})
    again = open_map(file)
    assert again.config == chart.config
    assert again.options == chart.options


def test_a_map_without_lines_has_no_outlines(tmp_path, capsys):
    _, file = save("tsdf", tmp_path)
    assert main(["map", "convert", str(file), "--to", "svg"]) == 2
    assert "has no outlines" in capsys.readouterr().err
    assert not (tmp_path / "room.svg").exists()


def test_outlines_are_drawn_in_metres_with_y_up():
    text = svg([np.array([[0.0, 0.0], [2.0, 1.0]]), np.array([[1.0, 1.0]])])
    assert 'viewBox="-0.500 -1.500 3.000 2.000"' in text
    assert text.count("<polyline") == 1
    assert 'points="0.000,-0.000 2.000,-1.000"' in text


def test_files_that_are_refused(tmp_path, capsys):
    _, file = save("grid", tmp_path)
    whole = file.read_bytes()
    cases = {
        "damaged": whole[:-10],
        "foreign": b"P5\n1 1\n255\n\x00",
        "missing": None,
    }
    for name, content in cases.items():
        bad = tmp_path / f"{name}.map"
        if content is not None:
            bad.write_bytes(content)
        assert main(["map", "convert", str(bad), "--to", "pgm"]) == 2
        error = capsys.readouterr().err.strip()
        assert str(bad) in error
        assert len(error.splitlines()) == 1
    write_map(tmp_path / "strange.map", "no-such-map", 1, {"resolution": [0.1]}, {})
    assert main(["map", "convert", str(tmp_path / "strange.map"), "--to", "pgm"]) == 2
    assert "no-such-map" in capsys.readouterr().err
