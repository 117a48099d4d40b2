"""What has been given to a link and not yet been acknowledged: in order, bounded, nothing forgotten silently."""

from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Entry:
    """A message on its way; `seq` counts the link's messages without gaps, `given` is when it was given [ns]."""

    seq: int
    stream: str
    type: str
    payload: bytes
    given: int

    @property
    def size(self) -> int:
        """Bytes it takes in the buffer, roughly."""
        return len(self.payload) + 128


class Outbox:
    """The sender's half: go-back-N with a window.

    Parameters
    ----------
    limit
        Bytes kept; beyond, the oldest messages are lost and counted.
    window
        Bytes on their way at a time.

    Attributes
    ----------
    lost
        Messages let go before they were acknowledged, by stream; those on their way may still arrive.
    """

    def __init__(self, limit: int, window: int) -> None:
        self.lost: dict[str, int] = {}
        self.resent = 0
        self.largest = 0  # bytes kept at most
        self._limit = limit
        self._window = window
        self._kept: deque[Entry] = deque()
        self._gone: deque[Entry] = deque()  # on their way, and no longer kept
        self._size = 0
        self._seq = 0  # of the next message
        self._next = 0  # to be sent
        self._ahead = 0  # first that has never been sent
        self._under_way = 0  # bytes
        self._probing = False

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def first(self) -> int:
        """The oldest number that can still be sent."""
        return self._kept[0].seq if self._kept else self._seq

    @property
    def waiting(self) -> bool:
        """Whether something was sent and not acknowledged."""
        return self._next > self.first or bool(self._gone)

    def full(self, size: int) -> bool:
        """Return whether a message of so many bytes would push an older one out."""
        return bool(self._kept) and self._size + size > self._limit

    def put(self, stream: str, type_name: str, payload: bytes, given: int) -> int:
        """Take a message; return how many older ones were lost for it."""
        entry = Entry(self._seq, stream, type_name, payload, given)
        self._seq += 1
        lost = 0
        while self.full(entry.size):
            old = self._kept.popleft()
            self._size -= old.size
            self.lost[old.stream] = self.lost.get(old.stream, 0) + 1
            lost += 1
            if old.seq < self._next:
                self._gone.append(old)
        self._kept.append(entry)
        self._size += entry.size
        self.largest = max(self.largest, self._size)
        return lost

    def take(self) -> Entry | None:
        """Return the next message to send, None while the window is full or all is sent."""
        self._next = max(self._next, self.first)
        index = self._next - self.first
        if index >= len(self._kept):
            return None
        entry = self._kept[index]
        if self._under_way and (self._probing or self._under_way + entry.size > self._window):
            return None
        self.resent += entry.seq < self._ahead
        self._next += 1
        self._ahead = max(self._ahead, self._next)
        self._under_way += entry.size
        return entry

    def acknowledge(self, expected: int) -> bool:
        """Forget what comes before the number the receiver expects; return whether there was such."""
        expected = min(expected, self._ahead)
        moved = False
        while self._gone and self._gone[0].seq < expected:
            old = self._gone.popleft()
            self._under_way -= old.size
            moved = True
        while self._kept and self._kept[0].seq < expected:
            entry = self._kept.popleft()
            self._size -= entry.size
            if entry.seq < self._next:
                self._under_way -= entry.size
            moved = True
        self._probing = self._probing and not moved
        return moved

    def rewind(self, *, probe: bool = False) -> None:
        """Send again from the first that was not acknowledged; with `probe` only that one until it is."""
        self._next, self._under_way, self._probing = self.first, 0, probe
        self._gone.clear()
