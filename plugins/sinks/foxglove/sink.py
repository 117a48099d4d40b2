"""The views of messages, published by the Foxglove SDK's server."""

from fnmatch import fnmatchcase
from typing import Any

import foxglove

from knotwork.core.contracts import Context, Sink
from knotwork.core.errors import KnotworkError
from knotwork.core.messages import Message
from knotwork.core.views import View, views
from knotwork.plugins.sinks.foxglove import FoxgloveConfig

_Shown = list[tuple[View, Any]]


class FoxgloveSink(Sink):
    """Renders a message only while somebody looks at its topic."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._config: FoxgloveConfig = context.config
        self._server: Any = None
        self._world = foxglove.Context()
        self._streams: dict[tuple[str, type[Message]], _Shown] = {}
        self._channels: dict[tuple[str, str], Any] = {}  # by topic and schema
        self._placed: dict[str, str] = {}  # frame to the stream that places it
        self._sent = 0

    def open(self) -> None:
        """Listen.

        Raises
        ------
        KnotworkError
            The address cannot be listened on.
        """
        config = self._config
        views("")  # imports the schemas now, not while messages wait
        try:
            self._server = foxglove.start_server(
                name=str(self.context.run.get("pipeline", "knotwork")),
                host=config.host,
                port=config.port,
                message_backlog_size=config.backlog,
                context=self._world,
            )
        except (OSError, RuntimeError, ValueError) as error:
            raise KnotworkError(
                f"cannot serve on {config.host}:{config.port}: {error}", hint="port 0 takes a free one"
            ) from error
        self.context.report("info", f"open a Foxglove WebSocket connection to ws://{config.host}:{self.port}")

    @property
    def port(self) -> int:
        """The port it listens on."""
        return int(self._server.port)

    def on_message(self, stream: str, message: Message) -> None:
        """Publish the views of one message."""
        key = (stream, type(message))
        shown = self._streams.get(key)
        if shown is None:
            shown = self._streams[key] = self._register(stream, message)
        for view, channel in shown:
            if view.places is not None:
                frame = view.places(message)
                if self._placed.setdefault(frame, stream) != stream:
                    continue
            if not channel.has_sinks():
                continue
            data = view.render(message)
            if data is not None:
                channel.log(data, log_time=max(message.time, 0))
                self._sent += 1

    def close(self) -> None:
        """Disconnect the viewers."""
        server, self._server = self._server, None
        if server is not None:
            server.stop()
        for channel in self._channels.values():
            channel.close()
        self._channels.clear()
        self._streams.clear()

    def statistics(self) -> dict[str, float]:
        """Return how many messages were sent."""
        return {"sent": self._sent}

    def _register(self, stream: str, message: Message) -> _Shown:
        config = self._config
        if not any(fnmatchcase(stream, pattern) for pattern in config.include):
            return []
        if any(fnmatchcase(stream, pattern) for pattern in config.exclude):
            return []
        return [(view, self._channel(stream, view)) for view in views(message.type_name)]

    def _channel(self, stream: str, view: View) -> Any:
        key = (view.topic or "/" + stream.replace(".", "/"), view.schema)
        channel = self._channels.get(key)
        if channel is None:
            schema = foxglove.Schema(name=view.schema, encoding=view.schema_encoding, data=view.definition)
            channel = self._channels[key] = foxglove.Channel(
                key[0], schema=schema, message_encoding=view.encoding, context=self._world
            )
        return channel
