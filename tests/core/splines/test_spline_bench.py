"""The bench compares like with like: every adapter that works here computes the same values."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[3] / "bench"


@pytest.fixture(scope="module")
def peers():
    spec = importlib.util.spec_from_file_location("spline_peers", FOLDER / "spline_peers.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["spline_peers"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["spline_peers"]


@pytest.mark.parametrize("task", ["curve", "curve_d", "surface", "surface_d"])
def test_adapters_agree(peers, task):
    rng = np.random.default_rng(0)
    control = rng.normal(size=(24, 2 if task.startswith("curve") else 24))
    points = rng.uniform(0, 1, 30 if task.startswith("curve") else (30, 2))
    truth = None
    # SciPy and the thesis's way are always there; other peers come with the extra `bench`.
    for library in (peers.Knotwork, peers.KnotworkSingle, peers.Thesis, peers.ScipyBSpline, peers.ScipyRect):
        if not hasattr(library, task):
            continue
        found = getattr(library(control, -0.15, 0.05), task)(points)
        found = found if isinstance(found, tuple) else (found,)
        truth = truth or found
        for ours, theirs in zip(truth, found, strict=True):
            np.testing.assert_allclose(theirs, ours, atol=2e-5 * np.abs(ours).max())
