"""MCAP files of other writers: Foxglove's schemas and ROS 2, whole, damaged and wrong."""

import io
import json
import math
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from mcap.writer import CompressionType, Writer
from mcap_ros2.writer import Writer as Ros2Writer
from PIL import Image
from ros_drive import MOUNT, START, Ros, check_drive, played
from rosbags.typesys import Stores

from knotwork.core.errors import DriverError, InputError
from knotwork.core.views.foxglove import protobuf_view

SECOND = 10**9


@pytest.fixture
def play(tmp_path):
    return partial(played, tmp_path)


@pytest.fixture
def ros2():
    return Ros(Stores.ROS2_HUMBLE)


@dataclass
class Schema:
    name: str
    encoding: str
    data: bytes


def write(path, messages, *, chunk_size=1 << 20, compression=CompressionType.ZSTD):
    """Write (topic, Schema, encoding, log time, bytes) with the reference implementation."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk_size, compression=compression)
        writer.start()
        schemas, channels = {}, {}
        for topic, schema, encoding, time, data in messages:
            if schema.name not in schemas:
                schemas[schema.name] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, encoding, schemas[schema.name])
            writer.add_message(channels[topic], time, data, time)
        writer.finish()
    return path


def ros2_file(path, ros2, messages):
    """Write ROS 2 messages with Foxglove's own writer for them."""
    with path.open("wb") as file:
        writer = Ros2Writer(file)
        schemas = {}
        for topic, name, time, message in messages:
            if name not in schemas:
                definition, _ = ros2.store.generate_msgdef(name, ros_version=2)
                schemas[name] = writer.register_msgdef(name, definition)
            writer.write_message(topic, schemas[name], as_plain(message), time, time)
        writer.finish()
    return path


def as_plain(message):
    """Return a message as nested dicts, which that writer takes."""
    if isinstance(message, np.ndarray):
        return message.tolist()
    if isinstance(message, list):
        return [as_plain(one) for one in message]
    if hasattr(message, "__msgtype__"):
        return {
            name: as_plain(getattr(message, name)) for name in message.__dataclass_fields__ if name != "__msgtype__"
        }
    return message


def test_ros_2_messages_inside_mcap(tmp_path, ros2, play):
    given, context = play("mcap-log", ros2_file(tmp_path / "a.mcap", ros2, ros2.drive()))
    check_drive(given)
    assert context.reports == []
    # arrival order: a scan comes after the odometry that was measured with it
    assert [port for port, _ in context.order][:5] == ["tf_static", "tf_static", "odom", "tf", "imu"]


def test_a_compressed_image_tells_its_size(tmp_path, ros2, play):
    file = io.BytesIO()
    Image.new("RGB", (12, 7)).save(file, "jpeg")
    messages = [("/image", "sensor_msgs/msg/CompressedImage", START, ros2.image(START, file.getvalue()))]
    given, _ = play("mcap-log", ros2_file(tmp_path / "a.mcap", ros2, messages))
    (image,) = given["image"]
    assert (image.encoding, image.width, image.height) == ("jpeg", 12, 7)
    assert image.data == file.getvalue()


def test_odometry_from_transforms_where_there_is_no_other(tmp_path, ros2, play):
    messages = [m for m in ros2.drive() if m[0] != "/odom"]
    given, _ = play("mcap-log", ros2_file(tmp_path / "a.mcap", ros2, messages))
    np.testing.assert_allclose([m.pose for m in given["odometry"]], [[0.1 * i, 2.0, 3.0] for i in range(5)], atol=1e-12)


def test_a_frame_that_nobody_places_is_told_once(tmp_path, ros2, play):
    messages = [m for m in ros2.drive() if m[0] != "/tf_static"]
    path = ros2_file(tmp_path / "a.mcap", ros2, messages)
    given, context = play("mcap-log", path)
    assert given["scan"][0].mount == (0.0, 0.0, 0.0)
    assert [text for _, text in context.reports if "base_scan" in text] == [context.reports[-1][1]]
    given, context = play("mcap-log", path, frames={"mounts": {"base_scan": MOUNT}})
    assert given["scan"][0].mount == MOUNT
    assert context.reports == []


def test_chosen_streams_are_all_that_is_given(tmp_path, ros2, play):
    path = ros2_file(tmp_path / "a.mcap", ros2, ros2.drive())
    given, _ = play("mcap-log", path, streams={"front": "/scan"})
    assert {port: len(messages) for port, messages in given.items()} == {"front": 5}
    with pytest.raises(InputError, match=r"no stream or topic '/scam'.*it has .*/scan \(scan\)"):
        play("mcap-log", path, streams={"front": "/scam"})


def foxglove_scans(n):
    """Return scans as protobuf messages and as JSON, with the lidar turned by a right angle."""
    for i in range(n):
        message = LaserScan(
            frame_id="base_link", start_angle=-1.0, end_angle=1.5, ranges=[1.0, 2.0, math.inf, 0.5, 3.0, 4.0]
        )
        message.timestamp.seconds = START // SECOND + i
        message.pose.position.x = 0.1
        message.pose.orientation.z = message.pose.orientation.w = math.sqrt(0.5)
        plain = {
            "timestamp": {"sec": START // SECOND + i, "nsec": 0},
            "frame_id": "base_link",
            "pose": {
                "position": {"x": 0.1, "y": 0, "z": 0},
                "orientation": {"x": 0, "y": 0, "z": math.sqrt(0.5), "w": math.sqrt(0.5)},
            },
            "start_angle": -1.0,
            "end_angle": 1.5,
            "ranges": [1.0, 2.0, None, 0.5, 3.0, 4.0],
            "intensities": [],
        }
        yield START + i * SECOND, message, plain


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_foxglove_schemas(tmp_path, play, encoding):
    if encoding == "protobuf":
        schema = Schema("foxglove.LaserScan", "protobuf", protobuf_view(LaserScan, None).definition)
        data = [(time, message.SerializeToString()) for time, message, _ in foxglove_scans(3)]
    else:
        schema = Schema("foxglove.LaserScan", "jsonschema", b"{}")
        data = [(time, json.dumps(plain).encode()) for time, _, plain in foxglove_scans(3)]
    path = write(tmp_path / "a.mcap", [("/front", schema, encoding, time, one) for time, one in data])
    given, context = play("mcap-log", path)
    assert context.reports == []
    assert [m.stamp for m in given["front"]] == [START + i * SECOND for i in range(3)]
    scan = given["front"][0]
    assert scan.mount == pytest.approx((0.1, 0.0, math.pi / 2))
    assert (scan.angle_min, scan.angle_increment) == (-1.0, 0.5)
    missing = np.inf if encoding == "protobuf" else np.nan  # JSON has no infinity; null is no number
    np.testing.assert_array_equal(scan.ranges, np.array([1.0, 2.0, missing, 0.5, 3.0, 4.0], np.float32))


def test_messages_that_are_not_what_their_schema_says_are_left_out_and_counted(tmp_path, play):
    scan = Schema("foxglove.LaserScan", "protobuf", b"")
    other = Schema("nobody/Knows", "jsonschema", b"{}")
    good = FrameTransform(parent_frame_id="odom", child_frame_id="base_link").SerializeToString()
    tree = Schema("foxglove.FrameTransform", "protobuf", b"")
    messages = [("/scan", scan, "protobuf", START + i, b"\xff\xff nonsense") for i in range(8)]
    messages += [("/tf", tree, "protobuf", START + 10 + i, good) for i in range(3)]
    messages += [("/other", other, "json", START + 20, b"{}")]
    path = write(tmp_path / "a.mcap", messages)
    given, context = play("mcap-log", path)
    assert given["scan"] == []
    assert len(given["tf"]) == 3  # the rest goes on
    assert context.counters == {"unreadable_messages": 8, "topics_left_out": 1}
    warnings = [text for level, text in context.reports if level == "warning"]
    assert len(warnings) == 6  # five one by one, and a sum
    assert "/scan" in warnings[0]
    assert "foxglove.LaserScan" in warnings[0]
    assert ("info", "not understood: /other (nobody/Knows)") in context.reports
    with pytest.raises(DriverError, match="strict: false"):
        play("mcap-log", path, strict=True)


@pytest.mark.parametrize(("data", "says"), [(b'{"oops": 1}', "but oops"), (b'{"ranges": []}', "without ranges")])
def test_json_of_another_schema_is_no_scan_without_beams(tmp_path, play, data, says):
    schema = Schema("foxglove.LaserScan", "jsonschema", b"{}")
    good = [(time, json.dumps(plain).encode()) for time, _, plain in foxglove_scans(3)]
    messages = [("/scan", schema, "json", time, each) for time, each in good]
    path = write(tmp_path / "a.mcap", [*messages, ("/scan", schema, "json", messages[-1][3] + 1, data)])
    given, context = play("mcap-log", path)
    assert len(given["scan"]) == 3
    assert context.counters["unreadable_messages"] == 1
    assert any(says in text for level, text in context.reports if level == "warning")


def test_a_broken_chunk_costs_its_own_messages_only(tmp_path, play):
    schema = Schema("foxglove.LaserScan", "protobuf", protobuf_view(LaserScan, None).definition)
    data = [(time, message.SerializeToString()) for time, message, _ in foxglove_scans(60)]
    path = write(
        tmp_path / "a.mcap", [("/scan", schema, "protobuf", time, one) for time, one in data], chunk_size=2000
    )  # fmt: skip
    whole, _ = play("mcap-log", path)
    assert len(whole["scan"]) == 60
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 0xFF
    path.write_bytes(content)
    given, context = play("mcap-log", path)
    stamps = [m.stamp for m in given["scan"]]
    assert 30 < len(stamps) < 60
    assert set(stamps) < {time for time, _ in data}
    assert context.counters["damaged_chunks"] == 1
    assert sum("chunk unreadable" in text for _, text in context.reports) == 1


def test_chunks_out_of_order_are_played_by_log_time(tmp_path, play):
    schema = Schema("foxglove.LaserScan", "protobuf", b"")
    data = [(time, message.SerializeToString()) for time, message, _ in foxglove_scans(60)]
    messages = [("/scan", schema, "protobuf", time, one) for time, one in data]
    path = write(tmp_path / "a.mcap", messages[30:] + messages[:30], chunk_size=2000)
    given, _ = play("mcap-log", path)
    assert [m.stamp for m in given["scan"]] == [time for time, _ in data]


def test_part_and_loop(tmp_path, play, ros2):
    path = ros2_file(tmp_path / "a.mcap", ros2, ros2.drive(10))
    given, _ = play("mcap-log", path, start=0.41, stop=1.0, streams={"scan": "/scan"})
    assert [(m.stamp - START) / SECOND for m in given["scan"]] == [0.4, 0.6, 0.8]
    given, _ = play("mcap-log", path, loop=3, streams={"scan": "/scan", "odom": "/odom"})
    assert [m.scan_id for m in given["scan"]] == list(range(30))
    stamps = [m.stamp for m in given["scan"]]
    assert stamps == sorted(set(stamps))
    assert [i for i, m in enumerate(given["odom"]) if m.discontinuity] == [10, 20]


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"", "empty, not an MCAP log"), (b"#ROSBAG V2.0\n", "not an MCAP log"), (None, "no such file")],
)
def test_what_is_no_log(tmp_path, play, content, says):
    path = tmp_path / "a.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=says):
        play("mcap-log", path)
