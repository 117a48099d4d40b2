"""The publisher."""

from typing import Any, ClassVar

from knotwork.core.contracts import Context, Sink
from knotwork.core.link import session as sessions
from knotwork.core.link.config import LinkConfig
from knotwork.core.messages import Message
from knotwork.core.ros2.messages import encode, encode_tf
from knotwork.plugins.sinks.ros2_out import Ros2OutConfig

_TF = "tf"


class Ros2Out(Sink):
    """Publishes each message of a stream on its topics."""

    prompt: ClassVar[bool] = True

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        config: Ros2OutConfig = context.config
        self._config = config
        self._link = LinkConfig(link="ros2", listen=config.listen, connect=config.connect, scouting=config.scouting)
        self._session: Any = None
        self._topics: dict[str, list[str]] = {}  # by stream
        for topic, streams in config.topics.items():
            for stream in streams:
                self._topics.setdefault(stream, []).append(topic.strip("/"))
        self._unfit: set[tuple[str, str]] = set()
        self._sent = 0

    def open(self) -> None:
        """Open the session; raises KnotworkError when its endpoint is taken."""
        self._session = sessions.acquire(self._link)

    def on_message(self, stream: str, message: Message) -> None:
        """Publish one message."""
        for topic in self._topics.get(stream, ()):
            made = (encode_tf if topic == _TF else encode)(message, self._config.frames)
            if made is None:
                self._tell(stream, topic, message.type_name)
                continue
            namespace = self._config.namespace.strip("/")
            self._session.put(f"{namespace}/{topic}" if namespace else topic, made[1])
            self._sent += 1

    def close(self) -> None:
        """Give the session back."""
        session, self._session = self._session, None
        if session is not None:
            sessions.release(self._link)

    def statistics(self) -> dict[str, float]:
        """Return how many messages were published."""
        return {"sent": self._sent}

    def _tell(self, stream: str, topic: str, kind: str) -> None:
        self.context.count("unfit_messages")
        if (stream, topic) not in self._unfit:
            self._unfit.add((stream, topic))
            self.context.report("error", f"topic {topic}: {stream} gives {kind}, which has no ROS 2 form here")
