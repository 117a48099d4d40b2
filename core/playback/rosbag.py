"""ROS bags as recordings, through the `rosbags` library: ROS 1 `.bag`, ROS 2 sqlite3 and MCAP, no ROS installed."""

import sqlite3
import struct
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import Connection
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from knotwork.core.errors import InputError
from knotwork.core.playback.bag1 import CutBag
from knotwork.core.playback.recording import Recording, Track, parts
from knotwork.core.playback.ros import ROS, ros2_name

# What the library lets through for bytes that are no such message.
_UNREADABLE = (SerdeError, struct.error, IndexError, KeyError, ValueError, AssertionError, TypeError, MemoryError)
_BROKEN = (AnyReaderError, TypesysError, OSError, sqlite3.Error, EOFError, *_UNREADABLE)
_TF1 = "geometry_msgs/TransformStamped[] transforms"  # tf/tfMessage, which the library's store lacks


class RosbagRecording(Recording):
    """One bag: a `.bag`, `.db3` or `.mcap` file or the folder of a ROS 2 bag; or several `.bag` files.

    A `.bag` without its index (a recorder that was killed) is read up to where it was cut.

    Raises
    ------
    InputError
        It cannot be opened or is no bag.
    """

    def __init__(self, path: str) -> None:
        super().__init__()
        self._path = path
        files = parts(path)
        self._cut: CutBag | None = None
        self._reader: AnyReader | None = None
        try:
            reader = AnyReader(files, default_typestore=_store(ros1=files[0].suffix == ".bag"))
            reader.open()
            self._reader = reader
            self.start, self.end = reader.start_time, reader.end_time
            topics = [(c.topic, c.msgtype, c.msgcount) for c in reader.connections]
        except _BROKEN as error:
            topics = self._open_cut(files, error)
        for topic, kind, count in topics:
            name = ros2_name(kind)
            found = ROS.get(name)
            if found is None:
                self.other[topic] = kind
            elif topic in self.tracks:
                self.tracks[topic].count += count
            else:
                decode = self._decoder(name) if self._cut is None else ros_decoder(name, ros1=True)
                self.tracks[topic] = Track(topic, found[0], "", decode, found[1], count=count)

    def messages(self, start: int, stop: int | None) -> Iterator[tuple[Track, int, bytes]]:
        """Yield track, time of recording [ns] and bytes; damage ends it, with a line."""
        try:
            for topic, time, data in self._all(start, stop):
                track = self.tracks.get(topic)
                if track is not None:
                    yield track, time, data
        except _BROKEN as error:
            self.damages.add("damaged_files", f"{self._path}: damaged: {error}; what came before it was read")
        if self._cut is not None:
            self.damages.add("cut_files", f"{self._path}: {self._cut.damage}; what came before it was read")

    def close(self) -> None:
        """Close the files."""
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()

    def _all(self, start: int, stop: int | None) -> Iterator[tuple[str, int, bytes]]:
        if self._cut is not None:
            for topic, time, data in self._cut.messages():
                if time >= start and (stop is None or time <= stop):
                    yield topic, time, data
        elif self._reader is not None:
            wanted: list[Connection] = [c for c in self._reader.connections if c.topic in self.tracks]
            if wanted:
                until = None if stop is None else stop + 1
                for connection, time, data in self._reader.messages(wanted, start=start, stop=until):
                    yield connection.topic, time, bytes(data)

    def _open_cut(self, files: list[Path], error: Exception) -> list[tuple[str, str, int]]:
        if len(files) == 1 and files[0].suffix == ".bag":
            cut = CutBag(files[0])
            if cut.topics:
                self._cut = cut
                self.start, self.end = cut.start, cut.end
                return [(topic, kind, cut.counts[topic]) for topic, kind in cut.topics.items()]
        text = " ".join(str(part) for part in error.args) or type(error).__name__
        raise InputError(
            f"not a bag that can be read: {text}",
            where=self._path,
            hint="name a .bag, .db3 or .mcap file or the folder of a ROS 2 bag",
        ) from error

    def _decoder(self, name: str) -> Callable[[bytes], Any]:
        reader = self._reader
        assert reader is not None
        return lambda data: _decoded(name, lambda: reader.deserialize(data, name))


def ros_decoder(name: str, *, ros1: bool) -> Callable[[bytes], Any]:
    """Return what decodes the standard message `package/msg/Type`; it raises ValueError."""
    store = _store(ros1)
    read = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    return lambda data: _decoded(name, lambda: read(data, name))


def _decoded(name: str, read: Callable[[], Any]) -> Any:
    try:
        return read()
    except (*_UNREADABLE, AnyReaderError) as error:
        raise ValueError(f"not a {name}: {error or type(error).__name__}") from error


@cache
def _store(ros1: bool) -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if ros1:
        store.register(get_types_from_msg(_TF1, "tf/msg/tfMessage"))
        store.register(get_types_from_msg(_TF1, "tf2_msgs/msg/TFMessage"))
    return store
