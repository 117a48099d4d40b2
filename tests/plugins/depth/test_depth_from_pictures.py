"""Pictures to depths: rendered walls of known depth, tracked by the camera driver, seen by an observer."""

import math
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
import yaml

cv2 = pytest.importorskip("cv2")

import rendered_scene  # noqa: E402

from knotwork.core import config, graph  # noqa: E402
from knotwork.core.registry import Registry  # noqa: E402
from knotwork.core.runtime import Run  # noqa: E402
from knotwork.plugins import BUILTINS  # noqa: E402

RATE, FRAMES, SPEED, SWING = 20.0, 60, 0.1, 0.2


def base_at(t):
    """Return x, y, yaw: the way back of `active-base`, whose heading swings to both sides."""
    return -SPEED * t, 0.0, SWING * math.sin(2 * math.pi * t * RATE / (FRAMES - 1))


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pictures")
    scene = rendered_scene.Scene()
    for k in range(FRAMES):
        cv2.imwrite(str(folder / f"{k:04}.png"), scene.picture(base_at(k / RATE)))
    (folder / "camera.yaml").write_text(rendered_scene.CALIBRATION)
    return folder


def depths_of(pictures, tmp_path, observer, *, odometry_rate=RATE, late=False):
    t = np.arange(0.0, (FRAMES - 1) / RATE + 1e-9, 1.0 / odometry_rate)
    nodes = {
        "way": {"plugin": "toy-way", "poses": [list(base_at(float(one))) for one in t], "rate": odometry_rate},
        "camera": {
            "plugin": "camera", "source": str(pictures), "calibration": str(pictures / "camera.yaml"), "rate": RATE,
            "features": 150,
        },
        "depths": {**observer, "offset": rendered_scene.OFFSET, "inputs": {"odometry": "way.out"}},
    }  # fmt: skip
    if late:  # of equal stamps, the first node's message comes first
        nodes = {name: nodes[name] for name in ("camera", "way", "depths")}
    file = tmp_path / "pipeline.yaml"
    file.write_text(yaml.safe_dump({"pipeline": "pictures", "nodes": nodes}, sort_keys=False))
    registry = Registry([*BUILTINS, "toy_nodes"], third_parties=False)
    loaded = config.load(file, registry)
    execution = Run(loaded, graph.build(loaded), registry, Path(tmp_path / "out"))
    streams = defaultdict(list)
    execution.tap(lambda stream, message: streams[stream].append(message))
    assert execution.execute().exit_code == 0
    return streams["depths.depths"]


@pytest.mark.parametrize(
    ("observer", "timing", "median", "most"),
    [
        ({"plugin": "depth-ekf"}, {}, 0.01, 0.03),
        ({"plugin": "depth-ekf"}, {"late": True}, 0.01, 0.03),
        ({"plugin": "depth-ekf"}, {"odometry_rate": 33.0}, 0.01, 0.03),
        ({"plugin": "depth-fixed-gain", "k_chi": "critical"}, {}, 0.03, 0.08),
    ],
    ids=["together", "odometry comes after", "odometry at its own stamps", "fixed gain"],
)
def test_depths_of_tracked_corners_are_those_of_the_walls(pictures, tmp_path, observer, timing, median, most):
    frames = depths_of(pictures, tmp_path, observer, **timing)
    assert len(frames) >= FRAMES - 2
    last = frames[-1]
    # A corner that a wall's edge makes with what is behind it is no point of the scene.
    depth = rendered_scene.Scene.depth(last.points, base_at(last.stamp * 1e-9), margin=0.025)
    known = np.isin(last.ids, frames[0].ids) & np.isfinite(depth)
    assert known.sum() > 25
    assert set(np.digitize(depth[known], (2.2, 3.0)).tolist()) == {0, 1, 2}  # on all three walls
    wrong = np.abs(1.0 / (last.chi * depth) - 1.0)[known]
    assert np.median(wrong) < median
    assert np.percentile(wrong, 95) < most
    if last.variance is not None:
        score = wrong * last.chi[known] / np.sqrt(last.variance[known])
        assert np.sqrt(np.mean(score**2)) < 2.0  # it knows how wrong it is
