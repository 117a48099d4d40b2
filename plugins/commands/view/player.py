"""Plays a log into a scene at the wall clock's pace."""

import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Condition

from mcap.exceptions import McapError
from mcap.reader import make_reader

from knotwork.core.contracts import Playback
from knotwork.core.errors import InputError
from knotwork.core.live.scene import Look, Scene
from knotwork.core.log.reader import Log
from knotwork.core.runtime.pace import Pace


class Player:
    """One log, played over and over as its viewers wish.

    Parameters
    ----------
    path
    rate
        None: as fast as possible.
    refresh
        Called when viewers must be told everything anew.

    Raises
    ------
    InputError
        The file cannot be opened, is no log, or has no stream of Knotwork.
    """

    def __init__(self, path: Path, rate: float | None) -> None:
        self.refresh: Callable[[], None] = lambda: None
        self.scene = Scene(self._extra)
        self._log = Log(path)
        self._pace = Pace(rate)
        self._changed = Condition()
        self._target: int | None = None  # where to go on [ns]
        self._stopping = False
        self._first, self._last = _extent(self._log)
        self._now = self._first

    @property
    def playback(self) -> Playback:
        """What pauses it and sets its rate."""
        return self._pace

    def seek(self, place: float) -> None:
        """Go to a share of the log, in [0, 1]."""
        with self._changed:
            self._target = self._first + round(place * (self._last - self._first))
            self._changed.notify_all()

    def stop(self) -> None:
        """End `play`."""
        with self._changed:
            self._stopping = True
            self._changed.notify_all()

    def play(self) -> None:
        """Play until `stop`; at its end the log waits to be sought in."""
        while not self._stopping:
            with self._changed:
                target, self._target = self._target, None
            if self._pass(target if target is not None else self._first):
                with self._changed:
                    self._changed.wait_for(lambda: self._stopping or self._target is not None)

    def _pass(self, target: int) -> bool:
        """Play from `target` [ns] on; return False when something else was asked for before the end."""
        self.scene.reset()
        self.refresh()
        begun = False
        for stream, message in self._log.messages():
            if message.time >= target:
                if not begun:
                    begun = True
                    self._pace.begin(message.time)
                    self.refresh()
                if not self._may_go_on(message.time):
                    return False
            elif self._stopping or self._target is not None:
                return False
            self.scene.take(stream, message)
            self._now = max(self._now, message.time) if begun else message.time
            if begun:
                self._pace.passed(message.type_name, self._now)
        return True

    def _may_go_on(self, time: int) -> bool:
        while True:
            wait = self._pace.wait(time, None, self._now)
            if self._stopping or self._target is not None:
                return False
            if wait <= 0:
                return True
            with self._changed:
                self._changed.wait(wait)

    def _extra(self) -> Look:
        span = max(self._last - self._first, 1)
        place = min(max((self._now - self._first) / span, 0.0), 1.0)
        return {
            "title": self._log.path.name,
            "playback": {"paused": self._pace.paused, "rate": self._pace.rate, "place": round(place, 4)},
            "drive": False,
            "stop": False,
        }


def _extent(log: Log) -> tuple[int, int]:
    """Return the first and last log time [ns]: from the index, or by reading a log that has none."""
    with suppress(McapError, OSError, ValueError, struct.error), log.path.open("rb") as file:
        summary = make_reader(file).get_summary()
        if summary is not None and summary.statistics is not None:
            topics = [channel.metadata for channel in summary.channels.values()]
            if any("stream" in metadata for metadata in topics):
                return summary.statistics.message_start_time, summary.statistics.message_end_time
    log.scan()
    times = [(c.first, c.last) for c in log.channels.values() if c.stream and c.count]
    if not times:
        raise InputError(
            "no stream that Knotwork wrote", where=str(log.path), hint="`knotwork log info` says what is in it"
        )
    return min(first for first, _ in times), max(last for _, last in times)
