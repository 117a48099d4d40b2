"""MCAP files as recordings: runs of Knotwork, Foxglove's schemas in JSON and protobuf, ROS 1 and 2 messages."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from knotwork.core import codec
from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.log.reader import Log, LogChannel
from knotwork.core.message_types import message_class
from knotwork.core.playback.recording import Recording, Track, parts
from knotwork.core.playback.ros import ROS, ros2_name

# What a log that does not say where its messages came from is fed back with.
_SENSORS = ("scan", "odometry", "imu", "wheels", "battery", "image", "features")
_NOTES = 3  # places of damage that are shown of a file


class McapRecording(Recording):
    """One MCAP file, or the parts of one run.

    Raises
    ------
    InputError
        A file cannot be opened or is not MCAP.
    """

    def __init__(self, path: str) -> None:
        super().__init__()
        self.logs = [Log(part) for part in parts(path)]
        self.run: dict[str, Any] = {}
        known: dict[str, LogChannel] = {}
        counts: dict[str, int] = {}
        for log in self.logs:
            log.overview()
            self.run = self.run or log.run
            for channel in log.channels.values():
                known.setdefault(_name(channel), channel)
                counts[_name(channel)] = counts.get(_name(channel), 0) + channel.count
        self._spans = [_span(log) for log in self.logs]
        self.start = min(first for first, _ in self._spans)
        self.end = max(last for _, last in self._spans)
        ours = any(channel.type for channel in known.values())
        for name, channel in known.items():
            if ours and not channel.type:
                continue  # a view of what is there in full
            try:
                track = self._own(channel) if channel.type else _foreign(channel)
            except KnotworkError as error:
                self.other[name] = error.message
                continue
            if track is None:
                self.other[name] = channel.schema or channel.encoding or "no schema"
            else:
                track.count = counts[name]
                self.tracks[name] = track

    def messages(self, start: int, stop: int | None) -> Iterator[tuple[Track, int, bytes]]:
        """Yield track, log time [ns] and bytes."""
        for log, (first, last) in zip(self.logs, self._spans, strict=True):
            if last < start or (stop is not None and first > stop):
                continue
            for channel, raw in log.raw(start, stop):
                track = self.tracks.get(_name(channel))
                if track is not None and bool(channel.type) == (track.convert is None):
                    yield track, raw.log_time, raw.data
            self._note(log)

    def _own(self, channel: LogChannel) -> Track:
        cls = message_class(channel.type)
        codec.check(cls)
        role = channel.metadata.get("role", "")
        node = channel.stream.partition(".")[0]
        external = self.run.get("external")
        source = node in external if isinstance(external, list) else channel.type in _SENSORS or role == "truth"
        return Track(channel.stream, channel.type, role, partial(codec.decode, cls), source=source)

    def _note(self, log: Log) -> None:
        damage = log.damage
        where = str(log.path)
        for line in damage.notes[:_NOTES]:
            self.damages.add("", f"{where}: {line}", 0)
        if len(damage.notes) > _NOTES:
            self.damages.add("", f"{where}: damaged at {len(damage.notes) - _NOTES} more places", 0)
        self.damages.add("damaged_chunks", "", damage.damaged_chunks)
        self.damages.add("damaged_records", "", damage.damaged_records)
        if not damage.complete:
            self.damages.add("cut_files", f"{where}: has no end; what is there was read (knotwork log recover {where})")
        for reason, n in log.unreadable.items():
            self.damages.add("unreadable_messages", f"{where}: {n} messages left out: {reason}", n)


def _span(log: Log) -> tuple[int, int]:
    """Return the first and last log time [ns] of a log that has been looked at."""
    used = [channel for channel in log.channels.values() if channel.count]
    return min((c.first for c in used), default=0), max((c.last for c in used), default=0)


def _name(channel: LogChannel) -> str:
    return channel.stream or channel.topic


def _foreign(channel: LogChannel) -> Track | None:
    """Return the track of a foreign channel; None when its messages are not understood."""
    from knotwork.core.playback.foxglove import FOXGLOVE, decoder

    if channel.encoding in ("cdr", "ros1"):
        found = ROS.get(ros2_name(channel.schema))
        decode: Callable[[bytes], Any] = _ros_decoder(channel) if found is not None else bytes
    elif channel.encoding in ("protobuf", "json"):
        found = FOXGLOVE.get(channel.schema)
        try:
            decode = decoder(channel.schema, channel.encoding) if found is not None else bytes
        except ImportError:
            return None
    else:
        return None
    if found is None:
        return None
    kind, convert = found
    return Track(channel.topic, kind, "estimate" if kind == "pose" else "", decode, convert)


def _ros_decoder(channel: LogChannel) -> Callable[[bytes], Any]:
    try:
        from knotwork.core.playback.rosbag import ros_decoder
    except ModuleNotFoundError as error:
        raise InputError(f"{channel.schema} needs {error.name}: pip install 'knotwork[ros]'") from error
    return ros_decoder(ros2_name(channel.schema), ros1=channel.encoding == "ros1")
