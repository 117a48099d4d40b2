"""Messages on their way from a device's thread to the dispatcher: bounded, every drop counted."""

from collections import deque
from dataclasses import dataclass
from threading import Condition
from typing import TYPE_CHECKING, Literal

from knotwork.core.messages import Message

if TYPE_CHECKING:
    from knotwork.core.runtime.dispatcher import Outlet

Policy = Literal["block", "drop-oldest", "latest"]


class Channel:
    """The bounded queue of one stream; `drops` counts what did not fit."""

    def __init__(self, size: int, policy: Policy) -> None:
        self.size = 1 if policy == "latest" else size
        self.policy = policy
        self.drops = 0
        self.waiting: deque[Entry] = deque()


@dataclass(slots=True)
class Entry:
    """A waiting message; `message` is None once it has been dropped."""

    outlet: "Outlet"
    message: Message | None


class Inbox:
    """The channels of all streams, taken in order of arrival."""

    def __init__(self) -> None:
        self._entries: deque[Entry] = deque()
        self._changed = Condition()
        self._closed = False

    def __bool__(self) -> bool:
        return bool(self._entries)

    def put(self, outlet: "Outlet", message: Message) -> None:
        """Leave a message; a full channel blocks or drops its oldest, as its policy says."""
        channel = outlet.channel
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
            entry = Entry(outlet, message)
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
                        entry.outlet.channel.waiting.popleft()
                        self._changed.notify_all()
                        return entry
                if timeout <= 0 or not self._changed.wait(timeout):
                    return None

    def close(self) -> None:
        """Refuse what comes from now on; whoever waits for room goes on."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
