"""`ros2-out` and `ros2-in` against a plain zenoh client that speaks CDR through `rosbags`."""

import socket
import time

import numpy as np
import pytest

from knotwork.core.clock import epoch
from knotwork.core.messages import Grid, Odometry, Pose, Scan

zenoh = pytest.importorskip("zenoh", reason="needs knotwork[zenoh]")
typesys = pytest.importorskip("rosbags.typesys", reason="needs the extra `test`")

from knotwork.core.link import session as sessions  # noqa: E402
from knotwork.core.link.config import LinkConfig  # noqa: E402
from knotwork.plugins.drivers.ros2_in import MANIFEST as IN  # noqa: E402
from knotwork.plugins.drivers.ros2_in.driver import Ros2In  # noqa: E402
from knotwork.plugins.sinks.ros2_out import MANIFEST as OUT  # noqa: E402
from knotwork.plugins.sinks.ros2_out.sink import Ros2Out  # noqa: E402

STORE = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)


@pytest.fixture
def endpoint():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    return f"tcp/127.0.0.1:{port}"


@pytest.fixture
def bridge(endpoint):
    """What stands where zenoh-bridge-ros2dds would."""
    config = LinkConfig(listen=(endpoint,))
    yield sessions.acquire(config)
    sessions.release(config)


def until(condition):
    end = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_nav2_sees_our_robot_and_map(bridge, endpoint, knotwork_context):
    got = {}
    subscriber = bridge.declare_subscriber("r1/**", lambda s: got.setdefault(str(s.key_expr), s.payload.to_bytes()))
    topics = {"scan": ["l.scan"], "odom": ["b.odometry"], "map": ["m.grid"], "tf": ["l.scan"], "wrong": ["p.pose"]}
    context = knotwork_context(OUT, {"connect": [endpoint], "namespace": "/r1", "topics": topics})
    node = Ros2Out(context)
    node.open()
    ranges = np.ones(4, np.float32)
    sent = (
        ("l.scan", Scan(stamp=5, scan_id=0, ranges=ranges, angle_min=0, angle_increment=1, range_min=0, range_max=9)),
        ("b.odometry", Odometry(stamp=5, pose=np.zeros(3))),
        ("m.grid", Grid(stamp=5, cells=np.zeros((2, 3), np.int8), resolution=0.05, origin=(0, 0, 0))),
        ("p.pose", Pose(stamp=5, role="estimate", pose=np.zeros(3))),
        ("p.pose", Pose(stamp=5, role="estimate", pose=np.zeros(3))),
    )

    def all_came():
        for stream, message in sent:
            node.on_message(stream, message.sealed(5, 0))
        return set(got) == {"r1/scan", "r1/odom", "r1/map", "r1/tf"}

    until(all_came)
    node.close()
    subscriber.undeclare()
    assert STORE.deserialize_cdr(got["r1/map"], "nav_msgs/msg/OccupancyGrid").info.width == 3
    assert STORE.deserialize_cdr(got["r1/tf"], "tf2_msgs/msg/TFMessage").transforms[0].child_frame_id == "laser"
    assert [text for level, text in context.reports if level == "error"] == [
        "topic wrong: p.pose gives pose, which has no ROS 2 form here"
    ]


def test_nav2_drives_our_robot(bridge, endpoint, knotwork_context):
    topics = {"twist": {"topic": "/cmd_vel", "message": "twist"}}
    context = knotwork_context(IN, {"connect": [endpoint], "topics": topics})
    node = Ros2In(context)
    node.open()
    node.start()
    vector = STORE.types["geometry_msgs/msg/Vector3"]
    theirs = STORE.types["geometry_msgs/msg/Twist"](linear=vector(0.2, 0.0, 0.0), angular=vector(0.0, 0.0, -0.4))
    data = bytes(STORE.serialize_cdr(theirs, "geometry_msgs/msg/Twist"))

    def came():
        bridge.put("cmd_vel", data)
        return context.messages("twist")

    until(came)
    bridge.put("cmd_vel", b"junk")
    until(lambda: context.counters.get("damaged_messages"))
    node.stop()
    node.close()
    twist = context.messages("twist")[0]
    assert (twist.vx, twist.wz) == (0.2, -0.4)
    assert 0 <= epoch() - twist.stamp < 30e9
