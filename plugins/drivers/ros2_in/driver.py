"""The subscriber."""

from collections.abc import Callable
from functools import partial
from typing import Any

from knotwork.core import clock
from knotwork.core.contracts import Context, Driver
from knotwork.core.errors import InputError
from knotwork.core.link import session as sessions
from knotwork.core.link.config import LinkConfig
from knotwork.core.messages import Message
from knotwork.core.ros2.messages import decode_odometry, decode_scan, decode_twist
from knotwork.plugins.drivers.ros2_in import Ros2InConfig, Topic


class Ros2In(Driver):
    """Gives what is published, with its header's stamp; a command gets the time of its arrival."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        config: Ros2InConfig = context.config
        self._config = config
        self._link = LinkConfig(link="ros2", listen=config.listen, connect=config.connect, scouting=config.scouting)
        self._session: Any = None
        self._subscribers: list[Any] = []
        self._scans = dict.fromkeys(config.topics, 0)
        self._told: set[str] = set()

    def open(self) -> None:
        """Open the session; raises KnotworkError when its endpoint is taken."""
        self._session = sessions.acquire(self._link)

    def start(self) -> None:
        """Listen."""
        for port, topic in self._config.topics.items():
            key, take = topic.topic.strip("/"), self._taker(port, topic)
            self._subscribers.append(self._session.declare_subscriber(key, partial(self._on_sample, port, take)))

    def stop(self) -> None:
        """Listen no longer."""
        subscribers, self._subscribers = self._subscribers, []
        for subscriber in subscribers:
            subscriber.undeclare()

    def close(self) -> None:
        """Give the session back."""
        self.stop()
        session, self._session = self._session, None
        if session is not None:
            sessions.release(self._link)

    def _taker(self, port: str, topic: Topic) -> Callable[[bytes], Message]:
        if topic.message == "scan":
            return lambda data: decode_scan(data, self._scans[port], topic.mount)
        if topic.message == "odometry":
            return decode_odometry
        return lambda data: decode_twist(data, clock.epoch())

    def _on_sample(self, port: str, take: Callable[[bytes], Message], sample: Any) -> None:
        try:
            message = take(sample.payload.to_bytes())
        except InputError as error:
            self.context.count("damaged_messages")
            if port not in self._told:
                self._told.add(port)
                self.context.report("warning", f"{port}: {error} (first of its kind)")
            return
        self._scans[port] += 1
        self.context.emit(port, message)
