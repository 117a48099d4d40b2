"""ROS 1 bags without an index, as a killed recorder leaves them: records one by one up to the cut.

Format: https://wiki.ros.org/Bags/Format/2.0. A record is a header (fields `name=value`, each with its
length) and data, each with its length; a chunk's data are records.
"""

import bz2
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]

from knotwork.core.errors import InputError

_MAGIC = b"#ROSBAG V2.0\n"
_LENGTH = struct.Struct("<I")
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7  # field `op`
_LIMIT = 1 << 30  # bytes; a larger claim is damage

Record = tuple[dict[str, bytes], bytes]


class CutBag:
    """One bag file; topics, counts and times come from a first pass.

    Attributes
    ----------
    topics
        Type ("sensor_msgs/LaserScan") by topic.
    damage
        Where the file ends too early; "" when it does not.

    Raises
    ------
    InputError
        Not such a bag.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.topics: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        self.damage = ""
        self.start = self.end = 0
        try:
            with path.open("rb") as file:
                head = file.read(len(_MAGIC))
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}", where=str(path)) from error
        if head != _MAGIC:
            raise InputError("not a ROS 1 bag of version 2.0", where=str(path))
        for topic, time, _ in self.messages():
            self.start = min(self.start or time, time)
            self.end = max(self.end, time)
            self.counts[topic] += 1

    def messages(self) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, time of recording [ns] and bytes in the file's order."""
        self.damage = "has no index"
        names: dict[int, str] = {}
        with self._path.open("rb") as file:
            at = file.seek(len(_MAGIC))
            while True:
                head = _block(file.read)
                body = _block(file.read) if head is not None else None
                if head is None or body is None:
                    self.damage += f", cut short after byte {at}"
                    return
                at = file.tell()
                try:
                    fields = _fields(head)
                    for one, data in self._records(fields, body):
                        if one["op"][0] == _CONNECTION:
                            self._connection(one, data, names)
                        elif one["op"][0] == _MESSAGE:
                            topic = names[_LENGTH.unpack(one["conn"])[0]]
                            seconds, nanoseconds = struct.unpack("<II", one["time"])
                            yield topic, seconds * 10**9 + nanoseconds, data
                except (KeyError, ValueError, IndexError, struct.error, OSError, RuntimeError, EOFError) as error:
                    self.damage += f", a damaged record before byte {at} ({error})"

    def _records(self, fields: dict[str, bytes], body: bytes) -> Iterator[Record]:
        if fields["op"][0] != _CHUNK:
            yield fields, body
            return
        packing = fields["compression"]
        data = body
        if packing == b"bz2":
            data = bz2.decompress(body)
        elif packing == b"lz4":
            data = lz4.frame.decompress(body)
        at = 0
        while at < len(data):
            (n,) = _LENGTH.unpack_from(data, at)
            head = data[at + 4 : at + 4 + n]
            at += 4 + n
            (n,) = _LENGTH.unpack_from(data, at)
            yield _fields(head), data[at + 4 : at + 4 + n]
            at += 4 + n

    def _connection(self, fields: dict[str, bytes], data: bytes, names: dict[int, str]) -> None:
        topic = fields["topic"].decode()
        names[_LENGTH.unpack(fields["conn"])[0]] = topic
        self.topics[topic] = _fields(data)["type"].decode()
        self.counts.setdefault(topic, 0)


def _block(read: Callable[[int], bytes]) -> bytes | None:
    """Return the bytes behind a length; None when the file ends before them."""
    head = read(4)
    if len(head) < 4:
        return None
    (n,) = _LENGTH.unpack(head)
    if n > _LIMIT:
        return None
    data = read(n)
    return data if len(data) == n else None


def _fields(head: bytes) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    at = 0
    while at < len(head):
        (n,) = _LENGTH.unpack_from(head, at)
        name, sign, value = head[at + 4 : at + 4 + n].partition(b"=")
        if not sign or n == 0:
            raise ValueError("not a header")
        found[name.decode("ascii", "replace")] = value
        at += 4 + n
    return found
