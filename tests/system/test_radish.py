"""The shipped pipelines on short stretches: they run, they repeat bit for bit, they are good."""

import json
from pathlib import Path

import pytest

from knotwork.core.log.digest import digest

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture(scope="module")
def intel(data, knotwork, tmp_path_factory) -> list[Path]:
    """Two runs of the first 800 scans of the Intel log."""
    outs = []
    for name in ("one", "two"):
        out = tmp_path_factory.mktemp(name)
        log = data / "intel" / "intel.clf.xz"
        done = knotwork(
            *("run", CONFIGS / "radish.yaml", "--set", f"vars.log={log}", "--set", "nodes.log.limit=800", "--out", out)
        )
        assert done.returncode == 0, done.stderr
        outs.append(out)
    return outs


@pytest.mark.data
def test_two_runs_of_the_same_log_are_the_same_bit_for_bit(intel):
    one, two = intel
    assert (one / "trajectory.tum").read_bytes() == (two / "trajectory.tum").read_bytes()
    assert (one / "map.pgm").read_bytes() == (two / "map.pgm").read_bytes()
    assert digest(one / "log.mcap") == digest(two / "log.mcap")


@pytest.mark.data
def test_everything_that_the_pipeline_promises_is_there(intel):
    out = intel[0]
    names = {"trajectory.tum", "map.png", "map.pgm", "map.yaml", "log.mcap", "summary.json", "config.yaml", "run.log"}
    assert names <= {p.name for p in out.iterdir()}
    summary = json.loads((out / "summary.json").read_text())
    assert summary["scans"] == 800
    assert summary["lost_scans"] == 0
    assert summary["map_bytes"] > 0
    lines = (out / "trajectory.tum").read_text().splitlines()
    assert len(lines) == 800
    assert lines[0].split()[0].startswith("976052857.33")


@pytest.mark.data
def test_the_resolved_configuration_runs_again_and_gives_the_same(intel, knotwork, tmp_path):
    done = knotwork("run", intel[0] / "config.yaml", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "trajectory.tum").read_bytes() == (intel[0] / "trajectory.tum").read_bytes()


def test_the_demo_maps_the_first_rooms_to_within_two_centimetres(knotwork, tmp_path):
    done = knotwork("run", CONFIGS / "demo.yaml", "--set", "nodes.sim.duration=60", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    truth = json.loads((tmp_path / "summary.json").read_text())["truth"]
    assert truth["n"] >= 290
    assert truth["position_rms_m"] <= 0.02
