"""The sending end of a link."""

import os
from fnmatch import fnmatchcase
from threading import Condition, Thread
from typing import Any, ClassVar

import zenoh

from knotwork.core import clock, codec
from knotwork.core.contracts import Context, Sink
from knotwork.core.errors import InputError
from knotwork.core.link import session as sessions
from knotwork.core.link import wire
from knotwork.core.link.outbox import Entry, Outbox
from knotwork.core.messages import Message
from knotwork.plugins.sinks.zenoh_out import ZenohOutConfig

_SILENCE = 1_000_000_000  # ns without an acknowledgement after which the link counts as lost
_LOOK = 0.05  # s between looks at whether something must be sent again
_BETWEEN_REWINDS = 50_000_000  # ns
_MEGABYTE = 1_000_000


class ZenohOut(Sink):
    """Keeps messages until the other end has them, and sends them in order.

    Commands are not kept: only the newest counts, and an old one must never move a robot.
    """

    prompt: ClassVar[bool] = True

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        config: ZenohOutConfig = context.config
        self._config = config
        self._session: Any = None
        self._subscribers: list[Any] = []
        self._number = int.from_bytes(os.urandom(8), "little") | 1  # of this process's link
        self._box = Outbox(round(config.buffer * _MEGABYTE), round(config.window * _MEGABYTE))
        self._blocks = config.when_full == "block" or (config.when_full == "auto" and context.playback is not None)
        self._changed = Condition()  # guards the box and what follows
        self._commands = 0
        self._progress = 0  # when the other end last had something new, or something was first sent [ns]
        self._rewound = 0
        self._acknowledged = False  # the other end has answered, ever
        self._lost_since: int | None = None  # when the link was lost [ns]; None while it works
        self._told_lost = self._told_full = False
        self._ending = self._closing = False
        self._wanted: dict[str, bool] = {}
        self._thread = Thread(target=self._keep, name=f"{context.name}-link", daemon=True)

    def open(self) -> None:
        """Open the session; raises KnotworkError when its endpoint is taken."""
        config = self._config
        self._session = sessions.acquire(config)
        base = wire.base(config.link)
        self._subscribers = [
            self._session.declare_subscriber(f"{base}/ack", self._on_ack),
            self._session.declare_subscriber(f"{base}/ping", self._on_ping),
        ]
        self._thread.start()

    def on_message(self, stream: str, message: Message) -> None:
        """Keep one message and send it if the window allows; a command is sent and not kept."""
        wanted = self._wanted.get(stream)
        if wanted is None:
            wanted = self._wanted[stream] = _chosen(self._config, stream)
        if not wanted:
            return
        given = clock.epoch()
        payload = codec.encode(message)
        if message.type_name in wire.COMMANDS:
            self._commands += 1
            self._put(Entry(self._commands, stream, message.type_name, payload, given), first=0)
            return
        with self._changed:
            size = len(payload) + 128
            while self._blocks and self._box.full(size) and not self._ending:
                self._changed.wait(_LOOK)
            if not self._box.waiting:
                self._progress = clock.monotonic()
            if self._box.put(stream, message.type_name, payload, given):
                self._tell_loss()
            self._send_all()

    def stop_motion(self) -> None:
        """Wait for room no longer: the run ends."""
        with self._changed:
            self._ending = True
            self._changed.notify_all()

    def finish(self) -> None:
        """Wait for the last acknowledgements, and say what was not delivered."""
        until = clock.monotonic() + round(self._config.drain * 1e9)
        with self._changed:
            while len(self._box) and self._lost_since is None and self._acknowledged and clock.monotonic() < until:
                self._changed.wait(_LOOK)
            left = len(self._box)
        if left:
            why = "its other end has not answered" if self._acknowledged else "nobody has taken them"
            self.context.report("warning", f"link {self._config.link}: {left} messages are not delivered: {why}")
        if any(self._box.lost.values()):
            self.context.report("warning", f"link {self._config.link}: lost in all: {_listed(self._box.lost)}")

    def close(self) -> None:
        """End the thread and give the session back."""
        with self._changed:
            self._closing = self._ending = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(5.0)
        subscribers, self._subscribers = self._subscribers, []
        for subscriber in subscribers:
            subscriber.undeclare()
        session, self._session = self._session, None
        if session is not None:
            sessions.release(self._config)

    def statistics(self) -> dict[str, float]:
        """Return messages numbered, resent, lost, waiting, commands, and the most that was kept [MB]."""
        box = self._box
        return {
            "resent": box.resent,
            "lost": sum(box.lost.values()),
            "waiting": len(box),
            "commands": self._commands,
            "kept_max_mb": box.largest / _MEGABYTE,
        }

    def _send_all(self) -> None:
        """Send as much as the window allows; called with the lock, so that nothing overtakes."""
        while (entry := self._box.take()) is not None:
            self._put(entry, self._box.first)

    def _keep(self) -> None:
        """Send what an acknowledgement has made room for, and again what got none."""
        with self._changed:
            while not self._closing:
                self._send_all()
                self._changed.wait(_LOOK)
                self._look()

    def _look(self) -> None:
        """Send again what was not acknowledged in time; called with the lock."""
        now = clock.monotonic()
        if not self._box.waiting:
            return
        if now - max(self._progress, self._rewound) > self._config.retry * 1e9:
            self._box.rewind(probe=True)
            self._rewound = now
        if now - self._progress > _SILENCE and self._lost_since is None:
            self._lost_since = self._progress
            self._told_lost = self._acknowledged
            if self._told_lost:
                self.context.report("warning", f"link {self._config.link} is lost: messages are kept until it is back")

    def _put(self, entry: Entry, first: int) -> None:
        head = wire.Head(self._number, entry.seq, first, entry.given, entry.type)
        self._publish(
            wire.data_key(self._config.link, entry.stream),
            entry.payload,
            attachment=head.pack(),
            congestion_control=zenoh.CongestionControl.DROP,
        )

    def _on_ack(self, sample: Any) -> None:
        try:
            ack = wire.Ack.unpack(sample.payload.to_bytes())
        except InputError:
            self.context.count("foreign_messages")
            return
        if ack.session != self._number:
            return
        now = clock.monotonic()
        with self._changed:
            self._acknowledged = True
            moved = self._box.acknowledge(ack.expected)
            if moved:
                self._progress = now
                self._tell_return(now)
                self._told_full = self._told_full and len(self._box) > 0
            if ack.gap and now - self._rewound > _BETWEEN_REWINDS:
                self._rewound = now
                self._box.rewind()
            self._changed.notify_all()

    def _on_ping(self, sample: Any) -> None:
        answered = clock.epoch()
        try:
            ping = wire.Ping.unpack(sample.payload.to_bytes())
        except InputError:
            self.context.count("foreign_messages")
            return
        pong = wire.Pong(self._number, ping.asker, ping.left, answered)
        self._publish(f"{wire.base(self._config.link)}/pong", pong.pack())

    def _publish(self, key: str, data: bytes, **more: Any) -> None:
        session = self._session  # a callback may still run while this end is closed
        if session is not None:
            session.put(key, data, express=True, **more)

    def _tell_loss(self) -> None:
        """Say that the buffer is full, once until all that waits has been delivered."""
        if not self._told_full:
            self._told_full = True
            text = f"link {self._config.link}: the buffer ({self._config.buffer:g} MB) is full: the oldest are lost"
            self.context.report("error", text)

    def _tell_return(self, now: int) -> None:
        if self._lost_since is None:
            return
        seconds = (now - self._lost_since) * 1e-9
        self._lost_since = None
        lost = f"lost so far: {_listed(self._box.lost)}" if any(self._box.lost.values()) else "nothing is lost"
        state = "back" if self._told_lost else "up"
        text = f"link {self._config.link} is {state} after {seconds:.1f} s: {len(self._box)} messages wait, {lost}"
        self.context.report("info", text)


def _chosen(config: ZenohOutConfig, stream: str) -> bool:
    return any(fnmatchcase(stream, p) for p in config.include) and not any(
        fnmatchcase(stream, p) for p in config.exclude
    )


def _listed(lost: dict[str, int]) -> str:
    return ", ".join(f"{stream} {n}" for stream, n in sorted(lost.items()) if n)
