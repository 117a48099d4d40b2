"""Finding where a robot has been before, against a room in closed form."""

import numpy as np
import pytest

from knotwork.core.conformance import RecordingContext
from knotwork.core.conformance.room import Room
from knotwork.core.messages import Scan
from knotwork.plugins.localizers.gauss_newton import GaussNewtonConfig
from knotwork.plugins.localizers.gauss_newton.descent import descend, discover
from knotwork.plugins.localizers.gauss_newton.solver import Settings
from knotwork.plugins.localizers.gauss_newton.starts import around
from knotwork.plugins.maps.spline_surface import MANIFEST
from knotwork.plugins.maps.spline_surface.map import SplineSurface

TRUTH = np.array([0.9, -0.1, 0.4])
DRIFTED = TRUTH + np.array([0.5, 0.75, 0.0])
ROOM = Room()


@pytest.fixture
def chart(tmp_path):
    """A room seen once, and part of it, drifted, seen often: as where a long loop meets its start."""
    chart = SplineSurface(RecordingContext(MANIFEST, {"resolution": [0.3, 0.125, 0.05]}, out=tmp_path))
    whole = ROOM.scan(TRUTH)
    chart.update(whole, TRUTH)
    ranges = whole.ranges.copy()
    ranges[150:] = np.nan
    half = Scan(
        stamp=0, scan_id=1, ranges=ranges, angle_min=whole.angle_min, angle_increment=whole.angle_increment,
        range_min=whole.range_min, range_max=whole.range_max,
    )  # fmt: skip
    for _ in range(12):
        chart.update(half, DRIFTED)
    return chart


def settings():
    config = GaussNewtonConfig()
    return Settings(config.loss, config.scale, config.iterations, config.tolerance, config.settle, config.damping)


def test_what_the_map_explains_tells_an_old_place_from_a_strong_half_of_a_wrong_one(chart):
    scan = ROOM.scan(TRUTH, scan_id=2)
    starts = around(DRIFTED, 1.5, 1.0, 3000)
    by_cost = descend(chart, scan, starts, DRIFTED, np.zeros((3, 3)), None, settings())
    assert np.linalg.norm(by_cost.pose - TRUTH) > 0.5  # the trap is there: the cost alone falls into it
    found = discover(chart, scan, starts, None, settings()).best
    np.testing.assert_allclose(found.pose, TRUTH, atol=0.02)
    assert found.explained() > GaussNewtonConfig().found
