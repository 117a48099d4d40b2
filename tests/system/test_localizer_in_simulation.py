"""The localiser's promises on simulated robots: what it says of its own errors, and when it is lost."""

from pathlib import Path

import numpy as np
import pytest

from knotwork.core import config, graph
from knotwork.core.registry import Registry
from knotwork.core.runtime import Run

SINKS = [f"nodes.{name}=~" for name in ("recorder", "picture", "export", "summary", "trajectory")]


@pytest.fixture
def simulate(tmp_path):
    """Run the demo pipeline; returns truths (n, 3) and estimates of the scans, and the run."""

    def run(*overrides: str):
        registry = Registry(third_parties=False)
        pipeline = config.load("configs:demo.yaml", registry, overrides=[*SINKS, *overrides])
        truth, estimates = {}, {}

        def tap(stream, message):
            if message.type_name == "pose" and message.role == "truth":
                truth[message.scan_id] = message.pose
            elif message.type_name == "pose" and message.role == "estimate":
                estimates[message.scan_id] = message

        execution = Run(pipeline, graph.build(pipeline), registry, Path(tmp_path))
        execution.tap(tap)
        result = execution.execute()
        assert result.exit_code == 0, result.failure
        ids = sorted(set(truth) & set(estimates))
        return np.array([truth[i] for i in ids]), [estimates[i] for i in ids]

    return run


def errors(truth, estimates):
    e = np.array([m.pose for m in estimates]) - truth
    e[:, 2] = (e[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return e


def test_the_normalised_error_averages_to_about_the_degrees_of_freedom(simulate):
    """Over more seeds: bench/consistency.py nees."""
    means = []
    for seed in range(5):
        truth, estimates = simulate(f"seed={seed}", "nodes.sim.duration=40")
        e = errors(truth, estimates)[1:]
        covariances = np.array([m.covariance for m in estimates])[1:]
        means.append(np.einsum("ni,nij,nj->n", e, np.linalg.inv(covariances), e).mean())
    assert 1.0 < np.mean(means) < 6.0, means


def test_along_a_featureless_corridor_it_follows_odometry_and_says_how_uncertain_that_is(simulate):
    world = ["nodes.sim.world=corridor-300m", "nodes.drive.world=corridor-300m", "nodes.sim.duration=60"]
    truth, estimates = simulate(*world)
    way = truth[-1, 0]
    assert way > 10.0
    e = errors(truth, estimates)
    assert abs(e[-1, 0]) < 0.012 * way  # a matcher that slides would be metres off
    sigma = np.sqrt([m.covariance[0, 0] for m in estimates])
    assert sigma[-1] > 2.0 * sigma[len(sigma) // 4] > 0.0  # grows all the way
    across = np.sqrt([m.covariance[1, 1] for m in estimates])
    assert np.abs(e[:, 1]).max() < 4 * across.max()


def test_a_kidnapped_robot_is_lost_within_two_seconds_and_found_on_return(simulate):
    kidnap = "nodes.sim.kidnap=[{at: 20, to: [9.5, 1.0, 1.5]}, {at: 26, to: [1.7, 1.4, 0.4]}]"
    truth, estimates = simulate(kidnap, "nodes.sim.stop_when_idle=0", "nodes.sim.duration=40")
    stamps = np.array([m.stamp for m in estimates]) / 1e9
    lost = np.array([m.lost for m in estimates])
    assert not lost[stamps < 20.0].any()
    assert 20.0 <= stamps[lost][0] <= 22.0
    assert lost[(stamps > 22.0) & (stamps < 26.0)].all()
    assert not lost[stamps > 32.0].any()
    assert np.abs(errors(truth, estimates)[-1, :2]).max() < 0.1
