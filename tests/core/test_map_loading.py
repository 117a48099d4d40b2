"""What every map refuses to load, and what it says."""

import pytest

from knotwork.core.conformance import RecordingContext
from knotwork.core.conformance.room import Room
from knotwork.core.errors import InputError
from knotwork.core.registry import Registry

REGISTRY = Registry(third_parties=False)


def chart(plugin, folder, **config):
    manifest = REGISTRY.find(plugin)
    return REGISTRY.load(manifest)(RecordingContext(manifest, {"resolution": [0.2]} | config, out=folder))


def saved(plugin, folder):
    made = chart(plugin, folder)
    room = Room()
    made.update(room.scan(room.poses(1)[0]), room.poses(1)[0])
    made.save(folder / f"{plugin}.map")
    return folder / f"{plugin}.map"


@pytest.mark.parametrize(
    ("saver", "loader", "config", "says"),
    [
        ("grid", "tsdf", {}, "holds a grid map"),
        ("grid", "spline-surface", {}, "holds a grid map"),
        ("grid", "grid", {"resolution": [0.1]}, "resolution"),
        ("grid", "grid", {"clamp": 7.0}, "clamp"),
        ("spline-surface", "spline-surface", {"clamp": 7.0}, "clamp"),
        ("tsdf", "grid", {}, "holds a tsdf map"),
    ],
)
def test_a_map_that_does_not_fit_is_refused_in_one_line(saver, loader, config, says, tmp_path):
    file = saved(saver, tmp_path)
    with pytest.raises(InputError) as caught:
        chart(loader, tmp_path, **config).load(file)
    assert says in str(caught.value)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)
