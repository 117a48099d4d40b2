"""The receiving end of a link."""

import os
from dataclasses import replace
from threading import Event, Lock, Thread
from typing import Any

import numpy as np

from knotwork.core import clock, codec
from knotwork.core.contracts import Context, Driver
from knotwork.core.errors import KnotworkError
from knotwork.core.geometry import compose, exp
from knotwork.core.link import session as sessions
from knotwork.core.link import wire
from knotwork.core.link.arrivals import Arrivals
from knotwork.core.link.clocks import ClockEstimate
from knotwork.core.message_types import message_class
from knotwork.core.messages import Message, MotionControl, Odometry
from knotwork.plugins.drivers.zenoh_in import RemoteStream, ZenohInConfig
from knotwork.plugins.drivers.zenoh_in.messages import LinkState

_TICK = 0.02  # s
_FIRST_PINGS = 16  # quickly, so that a command is soon believed
_PING_EVERY = 25  # ticks, after these
_STATE_EVERY = 50  # ticks
_PATIENCE = 250  # ticks after which it is said that nobody has answered
_ACK_EVERY = 16  # messages; and each tick
_SILENCE = 1_000_000_000  # ns without a pong: the link is down


class ZenohIn(Driver):
    """Gives what arrives, each message once and in order, with its origin's stamp.

    A command gets a stamp of this machine's clock: when it arrived, less its age (`ClockEstimate.age`). So
    the safety layer of a base judges it as one of its own, whatever the other clock says.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._config: ZenohInConfig = context.config
        self._ports: dict[str, list[tuple[str, RemoteStream]]] = {}
        for port, remote in self._config.streams.items():
            self._ports.setdefault(remote.stream, []).append((port, remote))
        self._asker = int.from_bytes(os.urandom(8), "little")
        self._session: Any = None
        self._subscribers: list[Any] = []
        self._lock = Lock()
        self._arrivals = Arrivals()
        self._clock = ClockEstimate()
        self._clock_of = 0  # session whose clock that is
        self._newest_command = (0, 0)  # session, number
        self._unacknowledged = 0
        self._received = self._late = self._refused = 0
        self._heard = 0  # last pong, monotonic [ns]
        self._up = False
        self._told: set[str] = set()
        self._done = Event()
        self._thread = Thread(target=self._keep, name=f"{context.name}-link", daemon=True)

    def open(self) -> None:
        """Open the session; raises KnotworkError when its endpoint is taken."""
        self._session = sessions.acquire(self._config)

    def start(self) -> None:
        """Listen."""
        base = wire.base(self._config.link)
        self._subscribers = [
            self._session.declare_subscriber(f"{base}/pong", self._on_pong),
            self._session.declare_subscriber(f"{base}/data/*/*", self._on_data),
        ]
        self._thread.start()

    def stop(self) -> None:
        """Listen no longer."""
        self._done.set()
        if self._thread.is_alive():
            self._thread.join(5.0)
        subscribers, self._subscribers = self._subscribers, []
        for subscriber in subscribers:
            subscriber.undeclare()

    def close(self) -> None:
        """Give the session back."""
        self.stop()
        session, self._session = self._session, None
        if session is not None:
            sessions.release(self._config)

    def statistics(self) -> dict[str, float]:
        """Return counts of messages, and the clock: offset and round trip [ms]."""
        arrivals = self._arrivals
        figures: dict[str, float] = {
            "received": self._received,
            "lost": arrivals.lost,
            "late": self._late,
            "duplicates": arrivals.duplicates,
            "refused_commands": self._refused,
        }
        if self._clock:
            figures |= {"offset_ms": self._clock.offset / 1e6, "round_trip_ms": self._clock.round_trip / 1e6}
        return figures

    def _keep(self) -> None:
        """Ping, acknowledge, tell the state."""
        tick = 0
        while not self._done.wait(_TICK):
            tick += 1
            if tick <= _FIRST_PINGS or tick % _PING_EVERY == 0 or (not self._clock and tick % 5 == 0):
                ping = wire.Ping(self._asker, clock.epoch())
                self._publish("ping", ping.pack())
            with self._lock:
                if self._unacknowledged:
                    self._acknowledge(gap=False)
            self._watch()
            if tick == _PATIENCE and not self._heard:
                self._tell_silence()
            if tick % _STATE_EVERY == 0 and self._received:
                self.context.emit("link", self._state())

    def _watch(self) -> None:
        up = self._heard > 0 and clock.monotonic() - self._heard < _SILENCE
        if up == self._up:
            return
        self._up = up
        name = self._config.link
        if up:
            figures = f"clock {self._clock.offset / 1e6:+.1f} ms, round trip {self._clock.round_trip / 1e6:.1f} ms"
            self.context.report("info", f"link {name} is up: {figures}")
        else:
            self.context.count("link_losses")
            self.context.report("warning", f"link {name} is lost: nothing comes until it is back")

    def _tell_silence(self) -> None:
        config = self._config
        ways = [f"connects to {', '.join(config.connect)}"] if config.connect else []
        ways += [f"listens at {', '.join(config.listen)}"] if config.listen else []
        self.context.report("info", f"link {config.link}: nobody has answered yet (it {' and '.join(ways)})")

    def _state(self) -> LinkState:
        known = bool(self._clock)
        return LinkState(
            stamp=self.context.now(),
            link=self._config.link,
            up=self._up,
            offset=self._clock.offset * 1e-9 if known else float("nan"),
            round_trip=self._clock.round_trip * 1e-9 if known else float("nan"),
            received=self._received,
            lost=self._arrivals.lost,
            late=self._late,
            refused=self._refused,
        )

    def _on_pong(self, sample: Any) -> None:
        back = clock.epoch()
        try:
            pong = wire.Pong.unpack(sample.payload.to_bytes())
        except KnotworkError:
            self.context.count("foreign_messages")
            return
        if pong.asker != self._asker:
            return
        with self._lock:
            if pong.session != self._clock_of:
                self._clock.forget()
                self._clock_of = pong.session
            self._clock.add(pong.left, pong.answered, back)
            self._heard = clock.monotonic()

    def _on_data(self, sample: Any) -> None:
        arrived = clock.epoch()
        try:
            head = wire.Head.unpack(sample.attachment.to_bytes() if sample.attachment is not None else b"")
            stream = ".".join(str(sample.key_expr).rsplit("/", 2)[1:])
            payload = sample.payload.to_bytes()
            with self._lock:
                if head.type in wire.COMMANDS:
                    self._command(stream, head, payload, arrived)
                else:
                    self._message(stream, head, payload, arrived)
        except KnotworkError as error:
            self.context.count("unusable_messages")
            self._tell("unusable", str(error))

    def _message(self, stream: str, head: wire.Head, payload: bytes, arrived: int) -> None:
        arrivals = self._arrivals
        before, sessions_before = arrivals.lost, arrivals.sessions
        verdict = arrivals.judge(head.session, head.seq, head.first)
        if arrivals.sessions > sessions_before > 0:
            self.context.report("warning", f"link {self._config.link}: the other end began anew")
        if arrivals.lost > before and sessions_before:
            text = f"link {self._config.link}: {arrivals.lost - before} messages were lost while it was down"
            self.context.report("warning", text)
        self._unacknowledged += 1
        if verdict == "new":
            self._deliver(stream, head, payload, arrived)
        if verdict == "gap" or self._unacknowledged >= _ACK_EVERY:
            self._acknowledge(gap=verdict == "gap")

    def _deliver(self, stream: str, head: wire.Head, payload: bytes, arrived: int) -> None:
        ports = self._ports.get(stream)
        if ports is None:
            return
        self._received += 1
        transit = self._clock.age(head.given, arrived) if self._clock else 0
        is_late = transit > self._config.late * 1e9
        self._late += is_late
        for port, remote in ports:
            message = self._decoded(stream, head, payload, remote)
            if message is None:
                continue
            if isinstance(message, MotionControl):
                if message.action == "rearm" and (not self._clock or transit > self._config.rearm_age * 1e9):
                    self._refused += 1
                    self._tell("rearm", "a re-arm that was too long on its way is refused: ask again")
                    continue
                message = replace(message, stamp=arrived)
            elif remote.extrapolate and is_late and transit <= self._config.horizon * 1e9:
                assert isinstance(message, Odometry)
                message = self._moved_on(message, transit)
            self.context.emit(port, message)

    def _moved_on(self, message: Odometry, transit: int) -> Odometry:
        """Return late odometry as it would be now, if the robot kept its twist."""
        if message.twist is None or not np.isfinite(message.twist).all():
            return message
        self.context.count("extrapolated")
        way = exp((message.twist * (transit * 1e-9)).tolist())
        pose = np.array(compose(message.pose.tolist(), way))
        return replace(message, stamp=message.stamp + transit, pose=pose)

    def _command(self, stream: str, head: wire.Head, payload: bytes, arrived: int) -> None:
        """Give a command with its age; an older one than the newest, or one whose age is unknown, is refused."""
        ports = self._ports.get(stream)
        if ports is None:
            return
        session, number = self._newest_command
        if not self._clock or (session == head.session and head.seq <= number):
            self._refused += 1
            return
        self._newest_command = (head.session, head.seq)
        self._received += 1
        age = self._clock.age(head.given, arrived)
        self._late += age > self._config.late * 1e9
        for port, remote in ports:
            message = self._decoded(stream, head, payload, remote)
            if message is not None:
                self.context.emit(port, replace(message, stamp=arrived - age))

    def _decoded(self, stream: str, head: wire.Head, payload: bytes, remote: RemoteStream) -> Message | None:
        """Return a message fit for the run, None when the config expects something else of its stream."""
        message = codec.decode(message_class(head.type), payload)
        role = getattr(message, "role", "")
        if head.type != remote.message or role != remote.role:
            self.context.count("unexpected_messages")
            got = f"{head.type} ({role})" if role else head.type
            self._tell(f"type {stream}", f"{stream} gives {got}, the config says {remote.message} {remote.role}")
            return None
        return replace(message, time=-1, seq=-1)

    def _acknowledge(self, *, gap: bool) -> None:
        self._unacknowledged = 0
        self._publish("ack", wire.Ack(self._arrivals.session, self._arrivals.expected, gap).pack())

    def _publish(self, what: str, data: bytes) -> None:
        session = self._session  # a callback may still run while this end is closed
        if session is not None:
            session.put(f"{wire.base(self._config.link)}/{what}", data, express=True)

    def _tell(self, kind: str, text: str) -> None:
        """Report the first of its kind."""
        if kind not in self._told:
            self._told.add(kind)
            self.context.report("warning", f"{text} (first of its kind)")
