"""A scan whose time odometry has not come to yet waits for it, but not for ever."""

import numpy as np
import pytest

from knotwork.core.conformance.context import RecordingContext
from knotwork.core.conformance.room import Room, scan_of
from knotwork.core.conformance.room_map import RoomMap
from knotwork.core.conformance.suite import _ROOM_MAP
from knotwork.core.contracts import PriorEstimate
from knotwork.plugins.localizers.gauss_newton import MANIFEST
from knotwork.plugins.localizers.gauss_newton.localizer import GaussNewton

MS = 1_000_000


class LatePrior:
    """The robot stands; odometry has come as far as `newest` [ns]."""

    newest = 10**12

    def prior(self, time):
        ahead = max(0, time - self.newest) * 1e-9
        return PriorEstimate(np.zeros(3), np.diag([0.01, 0.01, 0.0025]), np.zeros(3), False, ahead)


@pytest.fixture
def setting(tmp_path):
    prior = LatePrior()
    chart = RoomMap(RecordingContext(_ROOM_MAP, out=tmp_path))
    context = RecordingContext(MANIFEST, out=tmp_path, uses={"map": chart, "prior": prior})
    node = GaussNewton(context)
    for number in range(3):
        give(context, node, number, 1000 + 200 * number)
    return context, node, prior


def give(context, node, number, arrives, taken=None):
    """A scan taken (by default 200 ms before) and dispatched at these times [ms]."""
    context.time = arrives * MS
    ranges = Room().ranges(np.zeros(3), np.linspace(-np.pi, np.pi, 360, endpoint=False))
    stamp = (arrives - 200 if taken is None else taken) * MS
    node.on_scan(scan_of(ranges, stamp=stamp, scan_id=number).sealed(context.time, number))


def located(context):
    return [m.scan_id for _, m in context.emitted]


def test_scans_wait_for_the_odometry_of_their_time_in_order(setting):
    context, node, prior = setting
    assert located(context) == [0, 1, 2]
    prior.newest = 1250 * MS
    give(context, node, 3, 1600, 1300)
    give(context, node, 4, 1600, 1500)
    assert located(context) == [0, 1, 2]
    prior.newest = 1650 * MS
    give(context, node, 5, 1900, 1600)
    assert located(context) == [0, 1, 2, 3, 4, 5]


def test_a_scan_does_not_wait_for_longer_than_its_patience(setting):
    context, node, prior = setting
    prior.newest = 1250 * MS
    for number, arrives in ((3, 1600), (4, 1800), (5, 2000), (6, 2200)):
        give(context, node, number, arrives)
    assert located(context) == [0, 1, 2, 3, 4]  # 3 and 4 came 0.4 s ago and more


def test_odometry_that_has_been_away_for_a_second_is_not_waited_for(setting):
    context, node, prior = setting
    prior.newest = 1250 * MS
    give(context, node, 3, 2500)
    assert located(context) == [0, 1, 2, 3]


def test_what_waits_at_the_end_is_localised(setting):
    context, node, prior = setting
    prior.newest = 1250 * MS
    give(context, node, 3, 1600)
    node.finish()
    assert located(context) == [0, 1, 2, 3]


def test_patience_can_be_switched_off(tmp_path):
    prior = LatePrior()
    prior.newest = 0
    chart = RoomMap(RecordingContext(_ROOM_MAP, out=tmp_path))
    context = RecordingContext(MANIFEST, {"patience": 0}, out=tmp_path, uses={"map": chart, "prior": prior})
    node = GaussNewton(context)
    give(context, node, 0, 500)
    assert located(context) == [0]
