"""What is known of an emulated robot from outside: its true path, its wheels, what happened to it."""

import json
import threading
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from knotwork.core.emulator.robot import Robot
from knotwork.core.errors import InputError
from knotwork.core.evaluation.tum import tum_line

_PERIOD = 10_000_000  # ns between poses of the true path
_STANDING = 1e-3  # m/s
_KEPT = 20_000


@dataclass(frozen=True)
class Event:
    """Something that happened: a command that arrived, a watchdog that tripped, a fault switch.

    Attributes
    ----------
    stamp
        [ns since 1970]
    kind
        "command", "goal", "heartbeat", "bus_watchdog", "torque", "moving", "standing", "unplug", ...
    figures
        That go with it.
    """

    stamp: int
    kind: str
    figures: dict[str, float]


class Watch:
    """Writes the true path and the events, and remembers the events.

    Parameters
    ----------
    robot
        To watch.
    truth
        TUM file to write; None: none.
    frame
        Of the true path: "map" starts at the origin, "world" is the world's.
    events
        File of JSON lines to write; None: none.

    Raises
    ------
    InputError
        A file cannot be written.
    """

    def __init__(self, robot: Robot, truth: Path | None, frame: str, events: Path | None) -> None:
        self.events: deque[Event] = deque(maxlen=_KEPT)
        self.length = 0.0  # m driven
        self._robot = robot
        self._frame = frame
        self._next = robot.time
        self._moving = self._blocked = False
        self._last = robot.pose("world")
        self._lock = threading.Lock()  # events come from the loop and from whoever switches faults
        self._files = [_open(path) for path in (truth, events)]

    def note(self, stamp: int, kind: str, figures: dict[str, float]) -> None:
        """Remember an event."""
        with self._lock:
            self.events.append(Event(stamp, kind, figures))
            if self._files[1] is not None:
                self._files[1].write(json.dumps({"stamp": stamp, "event": kind, **figures}) + "\n")

    def look(self) -> int:
        """See where the robot is; returns when to look again [ns]."""
        stamp = self._robot.time
        moving = max(map(abs, self._robot.speeds)) > _STANDING
        if moving != self._moving:
            self._moving = moving
            self.note(stamp, "moving" if moving else "standing", {})
        if self._robot.base.blocked != self._blocked:
            self._blocked = self._robot.base.blocked
            if self._blocked:
                self.note(stamp, "collision", {})
        if stamp >= self._next:
            self._next = max(self._next + _PERIOD, stamp + _PERIOD // 2)
            here = self._robot.pose("world")
            self.length += ((here[0] - self._last[0]) ** 2 + (here[1] - self._last[1]) ** 2) ** 0.5
            self._last = here
            if self._files[0] is not None:
                self._files[0].write(tum_line(stamp, self._robot.pose(self._frame)) + "\n")
        return self._next

    def rest_after(self, stamp: int) -> float | None:
        """Return the time from `stamp` [ns] until both wheels stood for good [s]; None: they still turn."""
        newest = True
        for sample in reversed(self._robot.wheels):
            if sample.stamp <= stamp:
                break
            if max(abs(sample.left), abs(sample.right)) > _STANDING:
                return None if newest else (sample.stamp - stamp) * 1e-9
            newest = False
        return 0.0

    def close(self) -> None:
        """Write what is left."""
        with self._lock:
            for file in self._files:
                if file is not None:
                    file.close()
            self._files = [None, None]


def _open(path: Path | None) -> IO[str] | None:
    if path is None:
        return None
    try:
        return path.open("w", encoding="ascii", buffering=1)
    except OSError as error:
        raise InputError(f"cannot write: {error.strerror}", where=str(path)) from error
