"""The driver of a recording, and what its output ports are."""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

from knotwork.core.contracts import Context, Driver
from knotwork.core.errors import DriverError, InputError, KnotworkError
from knotwork.core.manifest import Port
from knotwork.core.messages import UNSET, Message, Odometry, Pose, Scan, Transform
from knotwork.core.playback.config import PlaybackConfig
from knotwork.core.playback.frames import Frames
from knotwork.core.playback.recording import Recording, Track

_SHOWN = 5  # bad messages reported one by one; the rest as a sum
_LOOK_AHEAD = 10_000_000_000  # ns in which transforms are looked for before the first scan is given
_SEAM = 100_000_000  # ns between the end and the next beginning of a loop


@dataclass(frozen=True, slots=True)
class Output:
    """A port and the track behind it; `dead_reckoning`: the track's transforms of base in odom, as odometry."""

    port: str
    track: Track
    dead_reckoning: bool = False

    @property
    def declared(self) -> Port:
        """How the port is declared."""
        if self.dead_reckoning:
            return Port("odometry", summary=f"from the transforms of {self.track.topic}")
        return Port(self.track.type, role=self.track.role, summary=f"{self.track.topic} of the recording")


def outputs(recording: Recording, config: PlaybackConfig) -> list[Output]:
    """Return the output ports of a recording.

    Raises
    ------
    InputError
        It has no such stream as the config names, or nothing that can be given.
    """
    if config.streams:
        return [_named(recording, config, port, topic) for port, topic in config.streams.items()]
    chosen = [track for track in recording.tracks.values() if track.source]
    if not chosen:
        have = _listed(recording)
        raise InputError(f"nothing in it is understood; it has {have}", where=config.path)
    short = [_last(track.topic) for track in chosen]
    found: list[Output] = []
    for track in chosen:
        alone = _is_stream(track.topic) and short.count(_last(track.topic)) == 1
        found.append(Output(_last(track.topic) if alone else _port(track.topic), track))
    if not any(output.track.type == "odometry" for output in found):
        moving = [o for o in found if o.track.convert is not None and o.track.type == "transform"]
        moving = [o for o in moving if not o.track.topic.endswith("static")]
        if moving:
            found.append(Output("odometry", moving[0].track, dead_reckoning=True))
    return found


def _named(recording: Recording, config: PlaybackConfig, port: str, topic: str) -> Output:
    track = recording.tracks.get(topic)
    if track is None:
        why = recording.other.get(topic)
        text = f"{topic!r} cannot be read ({why})" if why else f"it has no stream or topic {topic!r}"
        raise InputError(text, where=config.path, hint=f"it has {_listed(recording)}")
    from_transforms = port == "odometry" and track.type == "transform" and track.convert is not None
    return Output(port, track, dead_reckoning=from_transforms)


def _listed(recording: Recording) -> str:
    texts = [f"{track.topic} ({track.type})" for track in recording.tracks.values()]
    texts += [f"{topic} ({kind})" for topic, kind in recording.other.items()]
    return ", ".join(texts[:20]) + (f" and {len(texts) - 20} more" if len(texts) > 20 else "") or "no channel at all"


def _is_stream(topic: str) -> bool:
    return "." in topic and "/" not in topic


def _last(topic: str) -> str:
    return topic.rpartition(".")[2] if _is_stream(topic) else _port(topic)


def _port(topic: str) -> str:
    return topic.strip("/").replace("/", "-").replace(".", "-") or "messages"


class PlaybackDriver(Driver):
    """Gives the messages of a recording in their order of arrival.

    Messages of a logged run keep their `time` and `seq`, so that what is computed from them again is what
    was computed then. Of a foreign recording, scans are numbered from 0.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.settings: PlaybackConfig = context.config
        self._frames = Frames(self.settings.frames)
        self._recording: Recording | None = None
        self._outputs: dict[str, list[Output]] = {}
        self._numbers: dict[str, int] = {}  # next scan of a foreign track
        self._bad = 0
        self._share = 0.0

    @abstractmethod
    def recording(self) -> Recording:
        """Open the recording; raises InputError."""

    def open(self) -> None:
        """Open the recording and learn where its sensors are; raises DriverError."""
        try:
            self._recording = self.recording()
            chosen = outputs(self._recording, self.settings)
        except InputError as error:
            raise DriverError(error.message, where=error.where, hint=error.hint) from error
        for output in chosen:
            self._outputs.setdefault(output.track.topic, []).append(output)
        self._look_ahead()
        if self._recording.other:
            texts = [f"{topic} ({kind})" for topic, kind in self._recording.other.items()]
            self.context.count("topics_left_out", len(texts))
            more = f" and {len(texts) - 8} more" if len(texts) > 8 else ""
            self.context.report("info", f"not understood: {', '.join(texts[:8])}{more}")

    def close(self) -> None:
        """Close the recording."""
        recording, self._recording = self._recording, None
        if recording is not None:
            recording.close()

    def progress(self) -> float | None:
        """Return the share of the chosen part that has been given; None when it goes on for ever."""
        return None if self.settings.loop == 0 else self._share

    def events(self) -> Iterator[tuple[str, Message] | int]:
        """Yield `(port, message)`; at the end of a run's log the time at which that run ended."""
        if self._recording is None:
            self.open()
        recording = self._recording
        assert recording is not None
        start = recording.start + round(self.settings.start * 1e9)
        stop = None if self.settings.stop is None else recording.start + round(self.settings.stop * 1e9)
        end = recording.end if stop is None else min(stop, recording.end)
        given = 0
        logged = any(track.convert is None for track in recording.tracks.values())
        loop = _Loop(max(end - start, 0) + _SEAM)
        for turn in count():
            for port, message, arrival in self._play(recording, start, stop):
                given += 1
                part = (arrival - start) / max(end - start, 1)
                self._share = min(max((turn + part) / max(self.settings.loop, 1), 0.0), 1.0)
                yield port, loop.place(port, message)
            loop.next_turn()
            if turn == 0:
                self._tell_damage(recording)
            if not given or turn + 1 == self.settings.loop:
                break
        self._tell_end(given)
        if given and logged and stop is None and self.settings.loop == 1:
            yield end

    def _play(self, recording: Recording, start: int, stop: int | None) -> Iterator[tuple[str, Message, int]]:
        for track, arrival, data in recording.messages(start, stop):
            wanted = self._outputs.get(track.topic)
            if wanted is None:
                continue
            try:
                for message in self._read(track, arrival, data):
                    for output in wanted:
                        fitting = _as_odometry(message) if output.dead_reckoning else message
                        if fitting is not None:
                            yield output.port, fitting, arrival
            except (ValueError, ArithmeticError, AttributeError, KnotworkError) as error:
                self._refuse(track, arrival, error)

    def _read(self, track: Track, arrival: int, data: Any) -> list[Message]:
        found = track.decode(data)
        if track.convert is None:
            return [found]
        number = self._numbers.get(track.topic, 0)
        messages = list(track.convert(found, arrival, self._frames, number))
        self._numbers[track.topic] = number + len(messages)
        return messages

    def _look_ahead(self) -> None:
        """Learn from the first seconds' transforms, where scans need them."""
        recording = self._recording
        assert recording is not None
        trees = {t.topic for t in recording.tracks.values() if t.type == "transform" and t.convert is not None}
        if not trees or not any(t.type == "scan" and t.topic in self._outputs for t in recording.tracks.values()):
            return
        for track, arrival, data in recording.messages(recording.start, recording.start + _LOOK_AHEAD):
            if track.topic in trees and track.convert is not None:
                try:
                    list(track.convert(track.decode(data), arrival, self._frames, 0))
                except (ValueError, ArithmeticError, AttributeError):
                    continue  # told when it is played
        recording.damages.lines.clear()
        recording.damages.lost.clear()

    def _refuse(self, track: Track, arrival: int, error: Exception) -> None:
        text = error.message if isinstance(error, KnotworkError) else str(error)
        where = f"{self.settings.path}: {track.topic} at {arrival / 1e9:.3f} s"
        if self.settings.strict:
            raise DriverError(text, where=where, hint="strict: false leaves such messages out") from error
        self._bad += 1
        self.context.count("unreadable_messages")
        if self._bad <= _SHOWN:
            self.context.report("warning", f"{where}: {text}; message left out")

    def _tell_damage(self, recording: Recording) -> None:
        for counter, n in recording.damages.lost.items():
            if counter and n:
                self.context.count(counter, n)
        for line in recording.damages.lines:
            if self.settings.strict:
                raise DriverError(line, hint="strict: false keeps what could be read")
            self.context.report("warning", line)

    def _tell_end(self, given: int) -> None:
        if self._bad > _SHOWN:
            self.context.report("warning", f"{self.settings.path}: {self._bad} messages left out in all")
        for frame in sorted(self._frames.unknown):
            text = f"nothing says where frame {frame!r} is: its scans count as taken at the base (frames.mounts)"
            self.context.report("warning", text)
        if not given:
            self.context.report("warning", f"{self.settings.path}: no message in the part that was read")


class _Loop:
    """Moves each further turn behind the turns before it: stamps, times, dispatch and scan numbers."""

    def __init__(self, period: int) -> None:
        self._period = period
        self._turn = 0
        self._numbers = self._scans = 0  # how many a turn has
        self._begun: set[str] = set()  # ports that have given a message in this turn

    def next_turn(self) -> None:
        self._turn += 1
        self._begun.clear()

    def place(self, port: str, message: Message) -> Message:
        scan_id = getattr(message, "scan_id", -1)
        if self._turn == 0:
            self._numbers = max(self._numbers, message.seq + 1)
            self._scans = max(self._scans, scan_id + 1)
            return message
        moved = self._turn * self._period
        change: dict[str, Any] = {"stamp": message.stamp + moved}
        if message.seq != UNSET:
            change |= {"time": message.time + moved, "seq": message.seq + self._turn * self._numbers}
            if isinstance(message, Scan | Pose) and scan_id >= 0:  # those of a foreign recording go on by themselves
                change["scan_id"] = scan_id + self._turn * self._scans
        if isinstance(message, Odometry) and port not in self._begun:
            change["discontinuity"] = True
        self._begun.add(port)
        return replace(message, **change)


def _as_odometry(message: Message) -> Message | None:
    if isinstance(message, Transform) and message.parent == "odom" and message.child == "base":
        return Odometry(stamp=message.stamp, pose=message.pose)
    return None
