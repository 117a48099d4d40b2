import numpy as np
import pytest

from knotwork.core import geometry
from knotwork.core.depth.base_path import BasePath
from knotwork.core.messages import Odometry


def odometry(stamp, pose, **more):
    return Odometry(stamp=stamp, pose=np.array(pose), **more)


def test_between_two_poses_the_base_drives_an_arc():
    path = BasePath()
    assert path.at(0) is None
    assert path.covers(0)  # no odometry: nothing to wait for
    arc = geometry.exp((0.4, 0.0, 1.0))
    for k, pose in enumerate(((0.0, 0.0, 0.0), arc, geometry.compose(arc, arc))):
        path.add(odometry(100 * k, pose))
    for stamp in (0, 25, 100, 130, 200):
        np.testing.assert_allclose(path.at(stamp), geometry.exp((0.4 * stamp / 100, 0.0, stamp / 100)), atol=1e-12)
    assert path.at(-1) is None
    assert path.at(201) is None
    assert path.covers(200)
    assert not path.covers(201)


def test_old_poses_are_ignored_and_a_jump_begins_anew():
    path = BasePath()
    path.add(odometry(10, (1.0, 0.0, 0.0)))
    path.add(odometry(5, (9.0, 0.0, 0.0)))
    assert path.at(5) is None
    path.add(odometry(20, (5.0, 0.0, 0.0), discontinuity=True))
    assert path.at(15) is None
    assert path.at(20) == pytest.approx((5.0, 0.0, 0.0))
