"""Against the distance to a line and to a circle in closed form."""

import math

import numpy as np
import pytest

from knotwork.core.conformance import RecordingContext
from knotwork.core.messages import Scan
from knotwork.plugins.maps.tsdf import MANIFEST
from knotwork.plugins.maps.tsdf.kernels import UNKNOWN
from knotwork.plugins.maps.tsdf.map import TsdfMap

STEP = 0.05
ANGLES = np.deg2rad(np.arange(-60, 60, 0.5))


@pytest.fixture
def tsdf(tmp_path):
    def make(options=None, **config) -> TsdfMap:
        return TsdfMap(
            RecordingContext(
                MANIFEST, {"resolution": [STEP]} | config, options={"truncation": 0.3} | (options or {}), out=tmp_path
            )
        )

    return make


def scan(ranges):
    return Scan(
        stamp=0, scan_id=0, ranges=np.array(ranges, np.float32), angle_min=float(ANGLES[0]),
        angle_increment=float(ANGLES[1] - ANGLES[0]), range_min=0.05, range_max=50.0,
    )  # fmt: skip


def distances(chart):
    """Centres (n, 2) and distances (n,) [m] of all known cells."""
    i0, j0, i1, j1 = chart.cells[0].bounds()
    raw = chart.cells[0].block(i0, j0, i1, j1)
    i, j = np.nonzero(raw != UNKNOWN)
    return (np.column_stack([i + i0, j + j0]) + 0.5) * STEP, raw[i, j] * chart.truncation(0) / 32767


def test_the_distance_to_a_plane_is_exact_with_normals(tsdf):
    chart = tsdf()
    chart.update(scan(2.0 / np.cos(ANGLES)), np.zeros(3))
    centres, found = distances(chart)
    truncation = chart.truncation(0)
    assert truncation == 0.3
    middle = np.abs(centres[:, 1]) < 2.0  # off the ends of the wall
    expected = np.clip(2.0 - centres[:, 0], -truncation, truncation)
    near = middle & (np.abs(2.0 - centres[:, 0]) < 0.9 * truncation)
    assert near.sum() > 500
    assert found[near] == pytest.approx(expected[near], abs=1e-3)
    assert np.all(found[middle & (centres[:, 0] < 1.6)] == pytest.approx(truncation))


def test_projective_distances_are_too_long_by_the_slant_of_the_beam(tsdf):
    """At 45 deg to the wall, sqrt(2) of the distance: what the normal corrects."""
    chart = tsdf(options={"distance": "projective"})
    chart.update(scan(2.0 / np.cos(ANGLES)), np.zeros(3))
    centres, found = distances(chart)
    angle = np.arctan2(centres[:, 1], centres[:, 0])
    front = (2.0 - centres[:, 0] > 0.08) & (2.0 - centres[:, 0] < 0.15)
    slanted = front & (np.abs(angle - np.pi / 4) < 0.05)
    straight = front & (np.abs(angle) < 0.05)
    ratio = found / (2.0 - centres[:, 0])
    assert np.median(ratio[slanted]) == pytest.approx(math.sqrt(2), rel=0.05)
    assert np.median(ratio[straight]) == pytest.approx(1.0, rel=0.02)


def test_the_distance_to_a_circle(tsdf):
    """From its middle and from aside: to a few millimetres, the sagitta of a chord as long as the truncation."""
    chart = tsdf()
    for x, y in ((0.0, 0.0), (0.5, 0.3), (0.2, -0.4)):
        b = x * np.cos(ANGLES) + y * np.sin(ANGLES)
        chart.update(scan(-b + np.sqrt(b * b - (x * x + y * y - 4.0))), np.array([x, y, 0.0]))
    centres, found = distances(chart)
    expected = 2.0 - np.hypot(*centres.T)
    near = (np.abs(expected) < 0.15) & (np.abs(np.arctan2(centres[:, 1], centres[:, 0])) < 0.8)
    assert near.sum() > 300
    error = found[near] - expected[near]
    assert np.sqrt(np.mean(error**2)) < 0.006
    assert np.abs(error).max() < 0.03


def test_the_mean_of_noisy_measurements_converges(tsdf):
    chart = tsdf(options={"weight_max": 25})
    rng = np.random.default_rng(1)
    for _ in range(25):
        chart.update(scan(2.0 / np.cos(ANGLES) + rng.normal(0, 0.02, len(ANGLES))), np.zeros(3))
    centres, found = distances(chart)
    near = (np.abs(centres[:, 1]) < 1.0) & (np.abs(2.0 - centres[:, 0]) < 0.1)
    assert np.std(found[near] - (2.0 - centres[near, 0])) < 0.008


def test_occupied_at_the_wall_free_in_front_unknown_behind(tsdf):
    chart = tsdf()
    for _ in range(10):
        chart.update(scan(2.0 / np.cos(ANGLES)), np.zeros(3))
    y = np.linspace(-1.0, 1.0, 41)
    for x, low, high in ((2.0, 0.1, 1.0), (1.8, -1.0, -0.8), (1.0, -1.0, -0.3), (2.2, -0.05, 0.05), (3.0, 0.0, 0.0)):
        found = chart.occupancy(np.column_stack([np.full(41, x), y]))
        assert np.mean((found >= low) & (found <= high)) > 0.9, (x, found)


def test_three_bytes_a_cell(tsdf):
    chart = tsdf()
    chart.update(scan(2.0 / np.cos(ANGLES)), np.zeros(3))
    assert chart.cells[0].pool.itemsize + chart.weights[0].pool.itemsize == 3
    assert len(chart.weights[0].pool) == len(chart.cells[0].pool)
