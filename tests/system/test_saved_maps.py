"""Saved maps on a real log: localise only, go on mapping, swap the map by one key."""

import json
from pathlib import Path

import numpy as np
import pytest

CONFIG = Path(__file__).parents[2] / "configs" / "radish.yaml"
SCANS = 500


@pytest.fixture(scope="module")
def run(data, knotwork, tmp_path_factory):
    """Run the shipped pipeline on the first scans of the Intel log; return its folder."""

    def call(name, *settings):
        out = tmp_path_factory.mktemp(name)
        sets = [f"vars.log={data / 'intel' / 'intel.clf.xz'}", f"nodes.log.limit={SCANS}", *settings]
        arguments = [part for one in sets for part in ("--set", one)]
        done = knotwork("run", CONFIG, *arguments, "--out", out)
        assert done.returncode == 0, done.stderr
        return out

    return call


@pytest.fixture(scope="module")
def mapped(run):
    return run("slam", "nodes.map.save=intel.map")


def poses(out):
    return np.loadtxt(out / "trajectory.tum")[:, 1:3]


def lost(out):
    return json.loads((out / "summary.json").read_text())["lost_scans"]


@pytest.mark.data
def test_localise_only_in_a_saved_map(run, mapped):
    """From the start pose the same path, but where mapping slid for a while, and the map stays as it is."""
    out = run("localise", f"nodes.map.load={mapped / 'intel.map'}", "nodes.map.fuse=false", "nodes.map.save=same.map")
    error = np.linalg.norm(poses(out) - poses(mapped), axis=1)
    assert lost(out) == 0
    assert np.median(error) < 0.02
    assert error.max() < 0.15
    assert error[-50:].max() < 0.02
    assert (out / "map.pgm").read_bytes() == (mapped / "map.pgm").read_bytes()


@pytest.mark.data
@pytest.mark.parametrize("plugin", ["grid", "tsdf"])
def test_another_map_is_a_change_of_one_key(run, mapped, plugin):
    """Never lost, the surface's path but for a slide while all is new; then the map goes on from its file."""
    out = run(plugin, f"nodes.map.plugin={plugin}", "nodes.map.save=other.map")
    assert lost(out) == 0
    assert np.linalg.norm(poses(out) - poses(mapped), axis=1).max() < 0.25
    again = run(f"{plugin}-again", f"nodes.map.plugin={plugin}", f"nodes.map.load={out / 'other.map'}")
    assert lost(again) == 0


@pytest.mark.data
def test_a_map_of_another_plugin_is_one_clear_line(knotwork, mapped, data, tmp_path):
    settings = (
        "nodes.map.plugin=grid",
        f"nodes.map.load={mapped / 'intel.map'}",
        f"vars.log={data}/intel/intel.clf.xz",
    )
    arguments = [part for one in settings for part in ("--set", one)]
    done = knotwork("run", CONFIG, *arguments, "--out", tmp_path)
    assert done.returncode == 2
    assert "holds a spline-surface map of version 1, expected grid" in done.stderr
    assert "Traceback" not in done.stderr
