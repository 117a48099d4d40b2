"""Saved maps on a real log: localise only, go on mapping, swap the map by one key."""

import json
from pathlib import Path

import numpy as np
import pytest

from knotwork.core.evaluation.relations import read_relations, relation_errors
from knotwork.core.evaluation.tum import read_tum

CONFIGS = Path(__file__).parents[2] / "configs"
CONFIG = CONFIGS / "radish.yaml"
SCANS, RELATIONS = 500, 34  # relations between the first scans of the log


@pytest.fixture(scope="module")
def run(data, knotwork, tmp_path_factory):
    """Run a shipped pipeline on the first scans of a log, Intel's if no other is named; return its folder."""

    def call(name, *settings, config=CONFIG, log="intel", scans=SCANS):
        out = tmp_path_factory.mktemp(name)
        sets = [f"vars.log={data / log / log}.clf.xz", f"nodes.log.limit={scans}", *settings]
        arguments = [part for one in sets for part in ("--set", one)]
        done = knotwork("run", config, *arguments, "--out", out)
        assert done.returncode == 0, done.stderr
        return out

    return call


@pytest.fixture(scope="module")
def mapped(run):
    return run("slam", "nodes.map.save=intel.map")


def errors(out, data):
    """Translation errors [m] of the published relations between these scans; the map's frame does not matter."""
    relations = read_relations(data / "intel" / "intel.relations.xz")
    found, _, used = relation_errors(read_tum(out / "trajectory.tum"), relations)
    assert used.sum() == RELATIONS
    return found[used]


def poses(out):
    return np.loadtxt(out / "trajectory.tum")[:, 1:3]


def lost(out):
    return json.loads((out / "summary.json").read_text())["lost_scans"]


@pytest.mark.data
def test_localise_only_in_a_saved_map(run, mapped, data):
    """From the start pose as accurate as while mapping, and the map stays as it is."""
    out = run("localise", f"vars.map={mapped / 'intel.map'}", config=CONFIGS / "radish-localize.yaml")
    assert lost(out) == 0
    assert errors(out, data).mean() < errors(mapped, data).mean() + 0.001
    off = np.linalg.norm(poses(out) - poses(mapped), axis=1)
    assert np.median(off) < 0.01
    assert off[-50:].max() < 0.01
    assert (out / "map.pgm").read_bytes() == (mapped / "map.pgm").read_bytes()


@pytest.mark.data
def test_odometry_that_runs_backwards_does_not_lead_it_astray(run):
    """From 302 to 308 s the wheels of this log say forwards while the robot backs up: 0.2 m a scan between them."""
    first = run("fr079", "nodes.map.save=fr079.map", log="fr079", scans=1500)
    again = run("fr079-known", f"nodes.map.load={first / 'fr079.map'}", "nodes.map.fuse=false", log="fr079", scans=1500)
    assert lost(again) == 0
    assert np.linalg.norm(poses(again) - poses(first), axis=1).max() < 0.05


@pytest.mark.data
@pytest.mark.parametrize("plugin", ["grid", "tsdf", "spline-curve"])
def test_another_map_is_a_change_of_one_key(run, mapped, data, plugin):
    """Nearly as accurate on what is new; its file serves to localise only, and to go on mapping.

    The mean error of so few relations is itself known to 2 mm (0.010 m over the root of 34).
    """
    out = run(plugin, f"nodes.map.plugin={plugin}", "nodes.map.save=other.map")
    assert lost(out) == 0
    assert errors(out, data).mean() < errors(mapped, data).mean() + 0.005
    load = f"nodes.map.load={out / 'other.map'}"
    known = run(f"{plugin}-known", f"nodes.map.plugin={plugin}", load, "nodes.map.fuse=false")
    assert lost(known) == 0
    assert errors(known, data).mean() < errors(out, data).mean() + 0.002
    again = run(f"{plugin}-again", f"nodes.map.plugin={plugin}", load)
    assert lost(again) == 0
    assert errors(again, data).mean() < errors(out, data).mean() + 0.002


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
    assert "holds a spline-surface map of version 2, expected grid" in done.stderr
    assert "Traceback" not in done.stderr
