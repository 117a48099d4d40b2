"""How long to wait before the next attempt to reach a device."""

_FIRST = 0.1  # s
_LAST = 2.0  # s


class Backoff:
    """Waits that double up to two seconds; a robot is picked up and plugged in again, not called."""

    def __init__(self) -> None:
        self._next = _FIRST

    def reset(self) -> None:
        """Begin with short waits again."""
        self._next = _FIRST

    def delay(self) -> float:
        """Return the next wait [s]."""
        delay, self._next = self._next, min(2.0 * self._next, _LAST)
        return delay
