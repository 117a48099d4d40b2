"""The sink `foxglove` seen by a raw client of the protocol."""

import json
import struct
import time

import numpy as np
import pytest
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan

from knotwork.core.errors import KnotworkError
from knotwork.core.messages import Odometry, Scan, Transform

pytest.importorskip("foxglove", reason="needs knotwork[foxglove]")
websockets = pytest.importorskip("websockets.sync.client")

from knotwork.plugins.sinks.foxglove import MANIFEST  # noqa: E402
from knotwork.plugins.sinks.foxglove.sink import FoxgloveSink  # noqa: E402


@pytest.fixture
def sink(knotwork_context):
    made = []

    def make(**config):
        context = knotwork_context(MANIFEST, {"port": 0} | config)
        node = FoxgloveSink(context)
        node.open()
        made.append(node)
        return node, context

    yield make
    for node in made:
        node.close()


def scan(number):
    ranges = np.array([1.0, np.inf, 2.5], np.float32)
    message = Scan(
        stamp=number, scan_id=number, ranges=ranges, angle_min=0, angle_increment=1, range_min=0, range_max=9
    )
    return message.sealed(number, number)


def until_answer(client, wanted):
    while True:
        frame = client.recv(timeout=10)
        if wanted(frame):
            return frame


def advertised(client, topic):
    def has_it(frame):
        return isinstance(frame, str) and any(c["topic"] == topic for c in json.loads(frame).get("channels", ()))

    return next(c for c in json.loads(until_answer(client, has_it))["channels"] if c["topic"] == topic)


def test_a_client_sees_a_scan(sink):
    node, context = sink()
    assert f":{node.port}" in context.reports[0][1]
    node.on_message("lidar.scan", scan(0))
    assert node.statistics() == {"sent": 0}  # nobody looks: nothing is rendered
    address = f"ws://127.0.0.1:{node.port}"
    with websockets.connect(address, subprotocols=["foxglove.sdk.v1"], proxy=None) as client:
        channel = advertised(client, "/lidar/scan")
        assert channel["schemaName"] == "foxglove.LaserScan"
        assert channel["encoding"] == "protobuf"
        client.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channel["id"]}]}))
        end = time.monotonic() + 10
        while not node.statistics()["sent"]:
            assert time.monotonic() < end
            node.on_message("lidar.scan", scan(123))
            time.sleep(0.01)
        frame = until_answer(client, lambda f: isinstance(f, bytes) and f[0] == 1)
    number, log_time = struct.unpack_from("<IQ", frame, 1)
    assert (number, log_time) == (7, 123)
    seen = LaserScan.FromString(frame[13:])
    assert list(seen.ranges) == [1.0, np.inf, 2.5]


def test_left_out_streams_are_not_advertised(sink):
    node, _ = sink(include=["lidar.*"], exclude=["*.odometry"])
    node.on_message("lidar.scan", scan(0))
    node.on_message("lidar.odometry", Odometry(stamp=0, pose=np.zeros(3)).sealed(0, 0))
    node.on_message("base.odometry", Odometry(stamp=0, pose=np.zeros(3)).sealed(0, 0))
    assert [topic for topic, _ in node._channels] == ["/lidar/scan"]


def test_a_frame_has_one_parent(sink):
    node, _ = sink()
    for stream in ("a.tf", "b.tf"):
        node.on_message(stream, Transform(stamp=0, parent="map", child="odom", pose=np.zeros(3)).sealed(0, 0))
    assert node._placed == {"odom": "a.tf"}
    assert len(node._channels) == 1


def test_a_taken_port_is_said(sink):
    node, _ = sink()
    with pytest.raises(KnotworkError, match=f"{node.port}.*port 0"):
        sink(port=node.port)
