"""A scan that the map does not explain moves the robot only if the next one agrees."""

import numpy as np
import pytest

from knotwork.core.conformance import RecordingContext
from knotwork.core.conformance.room import Room
from knotwork.core.contracts import PriorEstimate
from knotwork.plugins.localizers.gauss_newton import MANIFEST
from knotwork.plugins.localizers.gauss_newton.localizer import GaussNewton
from knotwork.plugins.maps.spline_surface import MANIFEST as SURFACE
from knotwork.plugins.maps.spline_surface.map import SplineSurface

HERE = np.array([0.9, -0.1, 0.4])
THERE = np.array([1.6, 0.5, 0.2])  # where odometry does not know the robot to be
ROOM = Room()


class StandingPrior:
    """Odometry says that the robot stands where it was last found, and is sure of it."""

    pose = HERE

    def prior(self, time):
        return PriorEstimate(self.pose, np.diag([1e-4, 1e-4, 1e-4]), np.zeros(3), False, 0.0)


@pytest.fixture
def localise(tmp_path):
    """Localise scans taken at poses; returns the pose messages."""
    chart = SplineSurface(RecordingContext(SURFACE, {"resolution": [0.3, 0.125, 0.05]}, out=tmp_path))
    prior = StandingPrior()
    context = RecordingContext(MANIFEST, {"deskew": False}, out=tmp_path, uses={"map": chart, "prior": prior})
    node = GaussNewton(context)

    def run(*poses):
        for number, pose in enumerate(poses):
            context.time = number * 200_000_000
            node.on_scan(ROOM.scan(pose, stamp=context.time, scan_id=number, noise=0.005).sealed(context.time, number))
            prior.pose = context.emitted[-1][1].pose
        return [message for _, message in context.emitted]

    return run


def test_one_scan_from_elsewhere_does_not_move_the_robot(localise):
    messages = localise(HERE, HERE, THERE, HERE, HERE)
    off = np.array([np.hypot(*(m.pose - HERE)[:2]) for m in messages])
    assert messages[2].quality < 0.6  # it was seen to be wrong
    assert off.max() < 0.02
    assert not any(m.lost for m in messages)


def test_two_scans_that_agree_do(localise):
    messages = localise(HERE, HERE, THERE, THERE, THERE)
    for message in messages[3:]:
        np.testing.assert_allclose(message.pose, THERE, atol=0.03)
    assert not any(m.lost for m in messages)
