"""Everyone who looks: one thread tells all of them, and waits for none."""

import socket
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from threading import Condition, Thread

import msgspec

from knotwork.core import clock
from knotwork.core.live.scene import Look, Scene

_LOOKS_KEPT = 100


@dataclass(slots=True, eq=False)
class _Viewer:
    socket: socket.socket
    pending: memoryview = field(default_factory=lambda: memoryview(b""))
    since: int = 0  # when the last byte went out [ns]
    lacks: bool = True  # it must be told everything


class Viewers:
    """Sends looks at a scene to sockets as server-sent events.

    A viewer that is behind is left out until it has read what it was sent, then gets everything anew; one
    that reads nothing for `patience` is dropped. Memory is so bounded by one look a viewer, and a slow
    network costs nobody else anything.

    Parameters
    ----------
    scene
    period
        Between looks [s].
    patience
        [s]
    most
        Viewers at a time.

    Attributes
    ----------
    dropped, refused, peak
        Viewers that did not read; that were one too many; most at a time.
    on_drop
        Called when one is dropped.
    tick, told_at
        Number of the newest look, and when the newest few were sent (monotonic [ns]).
    """

    def __init__(self, scene: Scene, *, period: float, patience: float, most: int) -> None:
        self.dropped = self.refused = self.peak = 0
        self.on_drop: Callable[[], None] = lambda: None
        self.tick = 0
        self.told_at: dict[int, int] = {}
        self._scene = scene
        self._period = period
        self._patience = round(patience * 1e9)
        self._most = most
        self._all: list[_Viewer] = []
        self._changed = Condition()
        self._stopping = False
        self._thread = Thread(target=self._work, name="live viewers", daemon=True)

    def __len__(self) -> int:
        return len(self._all)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Say goodbye to everyone and end the thread."""
        with self._changed:
            self._stopping = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(5.0)

    def add(self, connection: socket.socket) -> bool:
        """Take over a connection that has got its response head; False when there are too many."""
        with self._changed:
            if self._stopping or len(self._all) >= self._most:
                self.refused += 1
                return False
            connection.setblocking(False)
            self._all.append(_Viewer(connection, since=clock.monotonic()))
            self.peak = max(self.peak, len(self._all))
            self._changed.notify_all()
            return True

    def refresh(self) -> None:
        """Tell everyone everything at the next look: the scene has begun anew."""
        with self._changed:
            for viewer in self._all:
                viewer.lacks = True

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._stopping or bool(self._all))
                viewers = list(self._all)
            self._tell(viewers)
            with self._changed:
                if self._changed.wait_for(lambda: self._stopping, self._period):
                    break
        self._tell(list(self._all))
        for viewer in list(self._all):
            self._close(viewer)

    def _tell(self, viewers: list[_Viewer]) -> None:
        if not viewers:
            return
        self.tick += 1
        self.told_at[self.tick] = clock.monotonic()
        self.told_at.pop(self.tick - _LOOKS_KEPT, None)
        news = self._encoded(self._scene.changes())
        everything: bytes | None = None
        for viewer in viewers:
            if viewer.pending and not self._flush(viewer):
                viewer.lacks = True
                continue
            if viewer.lacks:
                everything = everything or self._encoded(self._scene.everything())
            viewer.pending = memoryview(everything if viewer.lacks and everything else news)
            viewer.lacks = False
            viewer.since = clock.monotonic()
            self._flush(viewer)

    def _encoded(self, look: Look) -> bytes:
        return b"data: " + msgspec.json.encode({"tick": self.tick} | look) + b"\n\n"

    def _flush(self, viewer: _Viewer) -> bool:
        """Send what is pending; return whether all is gone. A viewer that has left or reads nothing is let go."""
        now = clock.monotonic()
        try:
            while viewer.pending:
                sent = viewer.socket.send(viewer.pending)
                viewer.pending = viewer.pending[sent:]
                viewer.since = now
        except BlockingIOError:
            if now - viewer.since > self._patience:
                self.dropped += 1
                self.on_drop()
                self._close(viewer)
            return False
        except OSError:  # it has gone
            self._close(viewer)
            return False
        return True

    def _close(self, viewer: _Viewer) -> None:
        with self._changed:
            if viewer in self._all:
                self._all.remove(viewer)
        with suppress(OSError):
            viewer.socket.shutdown(socket.SHUT_RDWR)
        viewer.socket.close()
