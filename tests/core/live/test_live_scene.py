import base64
import math

import msgspec
import numpy as np
import pytest

from knotwork.core import messages as m
from knotwork.core.conformance.samples import STEP, core_types, extremes, sample
from knotwork.core.live.scene import Scene


def taken(scene, *messages):
    for number, (stream, message) in enumerate(messages):
        scene.take(stream, message.sealed(max(message.stamp, 0), number))


def decoded(look):
    return msgspec.json.decode(msgspec.json.encode(look))


def pose(stamp, at, role="estimate", scan_id=-1, **more):
    return m.Pose(stamp=stamp, role=role, pose=np.array(at, float), scan_id=scan_id, **more)


def scan(ranges, scan_id=0, mount=(0.0, 0.0, 0.0)):
    return m.Scan(
        stamp=1, scan_id=scan_id, ranges=np.array(ranges, np.float32), angle_min=0.0, angle_increment=math.pi / 2,
        range_min=0.1, range_max=10.0, mount=mount,
    )  # fmt: skip


def test_every_message_there_is():
    scene, rng = Scene(), np.random.default_rng(0)
    for kind in core_types():
        taken(scene, *((f"n.{kind}", sample(kind, rng, number, number * STEP)) for number in range(3)))
    look = decoded(scene.everything())
    assert look["reset"]
    assert {"poses", "scans", "maps", "statistics", "events", "paths"} <= look.keys()
    taken(scene, *extremes())
    decoded(scene.everything())  # inf and NaN have no JSON


def test_hits_are_in_the_robots_frame():
    scene = Scene()
    mount = (0.5, 0.0, math.pi / 2)
    taken(scene, ("l.scan", scan([1.0, 2.0, math.inf, math.nan], mount=mount)))
    packed = scene.changes()["scans"]["l.scan"]["points"]
    points = np.frombuffer(base64.b64decode(packed), "<i2").reshape(-1, 2)
    assert points.tolist() == [[50, 100], [-150, 0]]  # cm: a beam at mount yaw, one a quarter turn further


def test_a_scan_lies_where_it_was_taken():
    scene = Scene()
    taken(scene, ("loc.pose", pose(1, [1, 2, 0.5], scan_id=7)), ("loc.pose", pose(2, [5, 5, 0], scan_id=8)))
    taken(scene, ("l.scan", scan([1.0], scan_id=7)))
    assert scene.changes()["scans"]["l.scan"]["at"] == [1, 2, 0.5]


def test_a_posterior_stands_beside_its_own_prior():
    scene = Scene()
    for stamp in (10, 20, 30):
        taken(scene, ("ekf.prior", pose(stamp, [stamp, 0, 0], role="prior")))
    taken(scene, ("loc.pose", pose(25, [22, 0, 0], scan_id=0)))
    assert scene.changes()["poses"]["loc.pose"]["prior"]["at"] == [20, 0, 0]


def test_truth_is_shown_in_the_maps_frame():
    scene = Scene()
    taken(scene, ("s.truth", pose(1, [3, 4, math.pi / 2], role="truth")))
    taken(scene, ("s.truth", pose(2, [3, 5, math.pi / 2], role="truth")))
    assert scene.changes()["poses"]["s.truth"]["at"] == pytest.approx([1, 0, 0], abs=1e-9)


class Page:
    """What state.js does with paths."""

    def __init__(self):
        self.points = []

    def take(self, look):
        path = look.get("paths", {}).get("loc.pose")
        if path:
            self.points = self.points[: 2 * path["at"]] + path["points"]


def test_changes_add_up_to_everything():
    scene, page, late = Scene(), Page(), Page()
    rng = np.random.default_rng(1)
    at = np.zeros(3)
    for number in range(200):
        at = at + rng.normal(0, 0.05, 3)
        taken(scene, ("loc.pose", pose(number, at, scan_id=number)))
        if number % 7 == 0:
            look = scene.changes()
            page.take(look)
            if number > 100:
                late.take(look)
        if number == 100:
            late.take(scene.everything())
            poses = rng.normal(0, 1, (50, 3))
            ids = np.arange(50, dtype=np.int64)
            taken(scene, ("loop.trajectory", m.Trajectory(stamp=number, scan_ids=ids, stamps=ids, poses=poses)))
    look = scene.changes()
    page.take(look)
    late.take(look)
    whole = Page()
    whole.take(scene.everything())
    assert page.points == late.points == whole.points
    assert len(whole.points) > 200


def test_lost_poses_leave_no_trace_in_the_path():
    scene = Scene()
    taken(scene, ("loc.pose", pose(1, [0, 0, 0])), ("loc.pose", pose(2, [9, 9, 0], lost=True)))
    look = scene.changes()
    assert look["paths"]["loc.pose"]["points"] == [0, 0]
    assert look["poses"]["loc.pose"]["lost"]


def test_raw_pictures_become_jpeg_and_come_seldom():
    scene = Scene()
    image = m.Image(stamp=1, data=bytes(range(0, 240, 10)), encoding="bgr8", width=4, height=2)
    shown = []
    for _ in range(10):
        taken(scene, ("cam.image", image))
        shown.append(scene.changes().get("images"))
    assert [look is not None for look in shown] == [False, False, False, False, True] * 2
    assert shown[4]["cam.image"]["src"].startswith("data:image/jpeg;base64,")
