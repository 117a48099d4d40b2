"""The stick on the page: one hand at a time, and only as long as the news of it is fresh."""

import math
from collections.abc import Callable
from threading import Lock
from typing import Any

from knotwork.core.errors import InputError


class Hand:
    """Where the stick is.

    The page sends the stick with the number of the newest look it has seen. That look's age bounds the age
    of the stick on any network, whatever was held up on the way, without a clock of the browser's.

    Parameters
    ----------
    hold
        Oldest look that still counts [ns].
    now
        Monotone clock [ns].
    told_at
        When a look was sent [ns], by its number.
    """

    def __init__(self, hold: int, now: Callable[[], int], told_at: dict[int, int]) -> None:
        self.counters = {"sticks": 0, "stale_sticks": 0, "second_hands": 0}
        self._hold = hold
        self._now = now
        self._told_at = told_at
        self._lock = Lock()
        self._owner = ""
        self._stick = (0.0, 0.0)
        self._alive = 0

    def move(self, command: dict[str, Any]) -> None:
        """Take `{who, forward, left, tick}`; raises InputError when it is refused."""
        who, tick = command.get("who"), command.get("tick")
        stick = tuple(command.get(name) for name in ("forward", "left"))
        if not isinstance(who, str) or not isinstance(tick, int) or not all(map(_is_share, stick)):
            raise InputError("expected who, tick, and forward and left within [-1, 1]")
        alive = self._told_at.get(tick, 0)
        with self._lock:
            if self._now() - alive > self._hold:
                self.counters["stale_sticks"] += 1
                raise InputError("too late: the connection is slow")
            if self._owner not in ("", who) and self._now() - self._alive <= self._hold:
                self.counters["second_hands"] += 1
                raise InputError("somebody else drives")
            self.counters["sticks"] += 1
            forward, left = stick
            assert forward is not None
            assert left is not None
            self._stick = (float(forward), float(left))
            self._owner = who if any(self._stick) else ""
            self._alive = max(alive, self._alive)

    def let_go(self) -> None:
        """Stand."""
        with self._lock:
            self._stick, self._owner = (0.0, 0.0), ""

    def stick(self) -> tuple[float, float]:
        """Return forward and left, (0, 0) when nobody holds the stick or it is too old."""
        with self._lock:
            return self._stick if self._now() - self._alive <= self._hold else (0.0, 0.0)


def _is_share(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value) and abs(value) <= 1
