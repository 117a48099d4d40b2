"""Messages on their way from a device's thread to the dispatcher: bounded, every drop counted."""

from collections import deque
from dataclasses import dataclass
from threading import Condition
from typing import Literal

from knotwork.core.messages import Message

Policy = Literal["block", "drop-oldest", "latest"]


@dataclass(slots=True)
class Entry:
    """A waiting message; `message` is None once it has been dropped."""

    channel: "Channel"
    message: Message | None
    arrived: int  # monotonic [ns]


class Channel:
    """The bounded queue of one stream; `drops` counts what did not fit."""

    def __init__(self, name: str, size: int, policy: Policy) -> None:
        self.name = name
        self.size = 1 if policy == "latest" else size
        self.policy = policy
        self.drops = 0
        self.waiting: deque[Entry] = deque()


class Inbox:
    """All channels, taken in order of arrival."""

    def __init__(self) -> None:
        self._entries: deque[Entry] = deque()
        self._changed = Condition()
        self._closed = False

    def put(self, channel: Channel, message: Message, arrived: int) -> None:
        """Leave a message; a full channel blocks or drops its oldest, as its policy says."""
        with self._changed:
            while len(channel.waiting) >= channel.size and not self._closed:
                if channel.policy == "block":
                    self._changed.wait()
                else:
                    channel.waiting.popleft().message = None
                    channel.drops += 1
            if self._closed:
                channel.drops += 1
                return
            entry = Entry(channel, message, arrived)
            channel.waiting.append(entry)
            self._entries.append(entry)
            self._changed.notify_all()

    def take(self, timeout: float) -> Entry | None:
        """Return the message that arrived first, waiting up to `timeout` [s] for one."""
        with self._changed:
            while True:
                while self._entries:
                    entry = self._entries.popleft()
                    if entry.message is not None:
                        entry.channel.waiting.popleft()
                        self._changed.notify_all()
                        return entry
                if timeout <= 0 or not self._changed.wait(timeout):
                    return None

    def wake(self) -> None:
        """Make a waiting `take` look again."""
        with self._changed:
            self._changed.notify_all()

    def close(self) -> None:
        """Refuse what comes from now on; whoever waits for room goes on."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def __bool__(self) -> bool:
        return bool(self._entries)
