"""ROS bags written by `rosbags`, read without ROS; and bags that a killed recorder left."""

import sqlite3
from functools import partial

import pytest
from ros_drive import START, Ros, check_drive, played
from rosbags.rosbag1 import Writer as Bag1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2
from rosbags.typesys import Stores

from knotwork.core.errors import InputError


@pytest.fixture
def play(tmp_path):
    return partial(played, tmp_path)


def bag1(path, n=5, compression=None):
    ros = Ros(Stores.ROS1_NOETIC)
    writer = Bag1(path)
    if compression is not None:
        writer.set_compression(compression)
    writer.chunk_threshold = 1000  # several chunks
    with writer:
        connections = {}
        for topic, name, time, message in ros.drive(n):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=ros.store)
            writer.write(connections[topic], time, ros.store.serialize_ros1(message, name))
    return path


def bag2(folder, storage):
    ros = Ros(Stores.ROS2_HUMBLE)
    with Bag2(folder, version=9, storage_plugin=storage) as writer:
        connections = {}
        for topic, name, time, message in ros.drive():
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=ros.store)
            writer.write(connections[topic], time, ros.store.serialize_cdr(message, name))
    return folder


@pytest.mark.parametrize("compression", [None, Bag1.CompressionFormat.BZ2, Bag1.CompressionFormat.LZ4])
def test_ros_1(tmp_path, play, compression):
    given, context = play("rosbag", bag1(tmp_path / "a.bag", compression=compression))
    check_drive(given)
    assert context.reports == []


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_ros_2_folder_and_file(tmp_path, play, storage):
    folder = bag2(tmp_path / "bag", storage)
    given, _ = play("rosbag", folder)
    check_drive(given)
    (file,) = (p for p in folder.iterdir() if p.suffix in (".db3", ".mcap"))
    given, _ = play("rosbag", file)
    check_drive(given)
    if storage is StoragePlugin.MCAP:
        given, _ = play("mcap-log", file)
        check_drive(given)


def test_part_of_a_bag(tmp_path, play):
    path = bag1(tmp_path / "a.bag", 10)
    given, _ = play("rosbag", path, start=0.5, stop=1.0, streams={"scan": "/scan"})
    assert [round((m.stamp - START) / 1e9, 1) for m in given["scan"]] == [0.6, 0.8]


@pytest.mark.parametrize("compression", [None, Bag1.CompressionFormat.LZ4])
def test_a_truncated_bag_gives_what_came_before_the_cut(tmp_path, play, compression):
    path = bag1(tmp_path / "a.bag", 40, compression)
    whole, _ = play("rosbag", path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    given, context = play("rosbag", path)
    n = len(given["scan"])
    assert 5 < n < 40
    assert [m.stamp for m in given["scan"]] == [m.stamp for m in whole["scan"][:n]]
    assert given["scan"][0].mount == whole["scan"][0].mount
    assert context.counters == {"cut_files": 1}
    (text,) = (text for _, text in context.reports)
    assert text.startswith(f"{path}: has no index, cut short after byte ")


def test_a_message_of_a_bag_that_cannot_be_read_is_left_out(tmp_path, play):
    folder = bag2(tmp_path / "bag", StoragePlugin.SQLITE3)
    (file,) = folder.glob("*.db3")
    with sqlite3.connect(file) as database:
        database.execute("update messages set data = x'0001' where id = 20")  # no such message
    database.close()
    given, context = play("rosbag", folder)
    assert sum(len(messages) for messages in given.values()) == 21
    assert context.counters == {"unreadable_messages": 1}


@pytest.mark.parametrize(
    ("name", "content"),
    [("a.bag", b""), ("a.bag", b"#ROSBAG V1.2\n"), ("a.db3", b"no database"), ("a.txt", b"text"), ("a.bag", None)],
)
def test_what_is_no_bag(tmp_path, play, name, content):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        play("rosbag", path)
    assert str(path) in str(caught.value)
