"""The curve map in the shipped pipelines: its own, and in the place of the surface."""

import json
from pathlib import Path

import pytest

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize("config", ["gallery.yaml", "demo.yaml"])
def test_only_the_plugin_changes(knotwork, tmp_path, config):
    done = knotwork(
        *("run", CONFIGS / config, "--set", "nodes.map.plugin=spline-curve", "--set", "nodes.sim.duration=15"),
        *("--out", tmp_path),
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["lost_scans"] == 0
    assert summary["truth"]["position_rms_m"] < 0.03
    assert (tmp_path / "map.png").exists()
    assert summary["map_bytes"] < 20_000
