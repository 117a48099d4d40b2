"""Views are decoded by Foxglove's own protobuf classes, and compared with building them field by field."""

import json
from math import atan2, pi

import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Grid_pb2 import Grid as GridView
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.timestamp_pb2 import Timestamp
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core.messages import (
    Battery,
    Event,
    Grid,
    Image,
    Imu,
    Odometry,
    Pose,
    Scan,
    Statistics,
    Trajectory,
    Transform,
    Twist,
    Wheels,
)
from knotwork.core.views import View, register_view, table, views, wire

STAMP = 976_052_857_337_234_001
TIME = Timestamp(seconds=976_052_857, nanos=337_234_001)
finite = st.floats(-1e6, 1e6)


def rendered(message, schema):
    (view,) = [view for view in views(message.type_name) if view.schema == schema.DESCRIPTOR.full_name]
    data = view.render(message)
    return None if data is None else schema.FromString(data)


def yaw(quaternion):
    assert quaternion.x == quaternion.y == 0
    assert quaternion.z**2 + quaternion.w**2 == pytest.approx(1)
    return 2 * atan2(quaternion.z, quaternion.w)


@given(st.integers(-(2**63), 2**63 - 1))
def test_stamps(stamp):
    timestamp = Timestamp.FromString(wire.stamp(1, stamp)[2:])
    assert timestamp.seconds * 10**9 + timestamp.nanos == stamp
    assert 0 <= timestamp.nanos < 10**9


@given(st.integers(1, 2**63 - 1))
def test_varint_is_protobufs(value):
    assert Timestamp(seconds=value).SerializeToString() == b"\x08" + wire.varint(value)


@given(st.lists(st.floats(width=32), max_size=30), finite, finite, st.floats(-pi, pi), st.booleans())
def test_scan(ranges, x, y, turn, with_intensities):
    beams = np.array(ranges, np.float32)
    message = Scan(
        stamp=STAMP,
        scan_id=0,
        ranges=beams,
        angle_min=-1.5,
        angle_increment=0.01,
        range_min=0.1,
        range_max=9.0,
        mount=(x, y, turn),
        intensities=beams[::-1] if with_intensities else None,
    )
    view = rendered(message, LaserScan)
    assert view.timestamp == TIME
    assert view.frame_id == "base"
    np.testing.assert_array_equal(np.array(view.ranges), beams.astype(float))
    np.testing.assert_array_equal(np.array(view.intensities), beams[::-1].astype(float) if with_intensities else [])
    assert (view.pose.position.x, view.pose.position.y, view.pose.position.z) == (x, y, 0)
    assert yaw(view.pose.orientation) == pytest.approx(turn)
    assert view.start_angle == -1.5
    assert view.end_angle == pytest.approx(-1.5 + 0.01 * max(len(ranges) - 1, 0))


@given(finite, finite, st.floats(-pi, pi), st.text(max_size=200), st.text(max_size=5))
def test_pose_and_transforms(x, y, turn, parent, child):
    at = np.array([x, y, turn])
    pose = Pose(stamp=STAMP, role="estimate", pose=at, frame=parent)
    view = rendered(pose, PoseInFrame)
    assert (view.timestamp, view.frame_id) == (TIME, parent)
    assert (view.pose.position.x, view.pose.position.y) == (x, y)
    assert yaw(view.pose.orientation) == pytest.approx(turn)
    for message, frames in (
        (Transform(stamp=STAMP, parent=parent, child=child, pose=at), (parent, child)),
        (Odometry(stamp=STAMP, pose=at, frame=parent, child=child), (parent, child)),
        (pose, (parent, "base")),
    ):
        view = rendered(message, FrameTransform)
        assert (view.timestamp, view.parent_frame_id, view.child_frame_id) == (TIME, *frames)
        assert (view.translation.x, view.translation.y, view.translation.z) == (x, y, 0)
        assert yaw(view.rotation) == pytest.approx(turn)


def test_only_an_estimate_places_the_robot():
    for role in ("prior", "truth"):
        assert rendered(Pose(stamp=0, role=role, pose=np.zeros(3)), FrameTransform) is None


@pytest.mark.parametrize("n", [0, 1, 7])
def test_trajectory(n):
    rng = np.random.default_rng(n)
    poses = rng.uniform(-3, 3, (n, 3))
    numbers = np.arange(n)
    message = Trajectory(stamp=STAMP, scan_ids=numbers, stamps=numbers, poses=poses)
    view = rendered(message, PosesInFrame)
    assert (view.timestamp, view.frame_id, len(view.poses)) == (TIME, "map", n)
    for found, (x, y, turn) in zip(view.poses, poses, strict=True):
        assert (found.position.x, found.position.y) == (x, y)
        assert yaw(found.orientation) == pytest.approx(turn)


def test_grid():
    cells = np.array([[0, 100, -1], [50, 25, -1]], np.int8)
    view = rendered(Grid(stamp=STAMP, cells=cells, resolution=0.05, origin=(1.0, -2.0, 0.5)), GridView)
    assert (view.column_count, view.row_stride, view.cell_stride) == (3, 12, 4)
    assert view.cell_size.x == view.cell_size.y == 0.05
    assert (view.pose.position.x, view.pose.position.y) == (1.0, -2.0)
    assert yaw(view.pose.orientation) == pytest.approx(0.5)
    assert [(f.name, f.offset, f.type) for f in view.fields] == [
        ("red", 0, 1),
        ("green", 1, 1),
        ("blue", 2, 1),
        ("alpha", 3, 1),
    ]
    colours = np.frombuffer(view.data, np.uint8).reshape(2, 3, 4)
    assert colours[0, 0].tolist() == [255, 255, 255, 255]
    assert colours[0, 1].tolist() == [0, 0, 0, 255]
    assert (colours[:, 2, 3] == 0).all()
    assert 120 < colours[1, 0, 0] < 135
    transposed = rendered(Grid(stamp=0, cells=cells.T, resolution=0.05, origin=(0, 0, 0)), GridView)
    assert np.frombuffer(transposed.data, np.uint8).reshape(3, 2, 4).tolist() == colours.transpose(1, 0, 2).tolist()
    empty = rendered(Grid(stamp=0, cells=np.zeros((0, 0), np.int8), resolution=0.1, origin=(0, 0, 0)), GridView)
    assert empty.data == b""


@pytest.mark.parametrize("level", ["debug", "info", "warning", "error"])
def test_event(level):
    view = rendered(Event(stamp=STAMP, node="n", level=level, text="t"), Log)
    assert (view.timestamp, view.name, view.message) == (TIME, "n", "t")
    assert Log.Level.Name(view.level) == level.upper()


def test_images():
    jpeg = Image(stamp=STAMP, data=b"abc", encoding="jpeg", width=2, height=1)
    assert rendered(jpeg, RawImage) is None
    assert (rendered(jpeg, CompressedImage).format, rendered(jpeg, CompressedImage).data) == ("jpeg", b"abc")
    raw = Image(stamp=STAMP, data=bytes(24), encoding="rgb8", width=4, height=2)
    assert rendered(raw, CompressedImage) is None
    assert (rendered(raw, RawImage).step, rendered(raw, RawImage).encoding) == (12, "rgb8")


@pytest.mark.parametrize(
    "message",
    [
        Twist(stamp=1, vx=float("inf"), wz=float("nan")),
        Imu(stamp=1, angular_velocity=np.ones(3), linear_acceleration=np.array([np.nan, 0, 9.8])),
        Wheels(stamp=1, angle=np.ones(2), velocity=np.zeros(2)),
        Battery(stamp=1, voltage=11.1),
        Statistics(stamp=1, data={"map": {"p95": np.float64(1.5), "n": 3}}),
    ],
)
def test_json_views_are_strict_json(message):
    (view,) = views(message.type_name)
    shown = json.loads(view.render(message), parse_constant=lambda text: pytest.fail(f"{text} is not JSON"))
    schema = json.loads(view.definition)
    assert schema["type"] == "object"
    assert shown.keys() == schema["properties"].keys()
    assert shown["stamp"] == 1


def test_a_third_party_adds_a_view(monkeypatch):
    monkeypatch.setattr(table, "_TABLE", {})
    view = View("acme.Thing", "json", b"{}", lambda message: b"{}")
    register_view("thing", view)
    assert views("thing") == (view,)
    assert views("nothing") == ()
    assert [v.schema for v in views("scan")] == ["foxglove.LaserScan"]
