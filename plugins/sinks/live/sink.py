"""The run's side of the page."""

import os
import secrets
from pathlib import Path
from typing import Any, Literal

from knotwork.core import clock
from knotwork.core.contracts import Context, Sink
from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.live.playback import playback_commands
from knotwork.core.live.scene import Look, Scene
from knotwork.core.live.server import Commands, LiveServer, is_local
from knotwork.core.messages import Message, MotionControl
from knotwork.plugins.sinks.live import LiveConfig
from knotwork.plugins.sinks.live.hand import Hand


class Live(Sink):
    """Hands messages to a scene, which the server's threads look at; implements `contracts.Stick`."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._config: LiveConfig = context.config
        self._server: LiveServer | None = None
        self._hand: Hand | None = None
        self._driven = False  # a policy asks for the stick
        self._seen: set[str] = set()  # message types
        self._scene = Scene(self._extra)
        self._totals: dict[str, float] = {}

    def open(self) -> None:
        """Serve the page.

        Raises
        ------
        KnotworkError
            The address is taken, or the token cannot be read or kept.
        """
        config, context = self._config, self.context
        commands: Commands = {"stop": self._stop, "rearm": self._rearm, "stick": self._move}
        if context.playback is not None:
            commands |= playback_commands(context.playback)
            if config.paused:
                context.playback.pause()
        server = LiveServer(
            self._scene,
            commands,
            host=config.host,
            port=config.port,
            token=self._token(),
            period=1.0 / config.rate,
            patience=config.patience,
            most=config.viewers,
        )
        server.viewers.on_drop = lambda: context.report("warning", "a viewer that reads nothing was dropped")
        self._hand = Hand(round(config.hold * 1e9), clock.monotonic, server.viewers.told_at)
        server.start()
        self._server = server
        if server.token:
            note = context.out / f"{context.name}.url"
            _keep_secret(note, server.address_with_token + "\n")
            context.report("info", f"live at {server.address}; the address with its token is in {note}")
        else:
            context.report("info", f"live at {server.address}")

    def on_message(self, stream: str, message: Message) -> None:
        """Show one message, when somebody looks."""
        self._seen.add(message.type_name)
        self._scene.take(stream, message)

    def stop_motion(self) -> None:
        """Let the stick go."""
        if self._hand is not None:
            self._hand.let_go()

    def close(self) -> None:
        """End the server; pages keep what they show."""
        server, self._server = self._server, None
        if server is not None:
            self._totals = self._figures(server)
            server.stop()

    def stick(self) -> tuple[float, float]:
        """Return forward and left, each in [-1, 1], of whoever drives."""
        self._driven = True
        return self._hand.stick() if self._hand is not None else (0.0, 0.0)

    def statistics(self) -> dict[str, float]:
        """Return counts of viewers, requests and sticks."""
        return self._totals if self._server is None else self._figures(self._server)

    def _figures(self, server: LiveServer) -> dict[str, float]:
        return {**server.statistics(), **(self._hand.counters if self._hand is not None else {})}

    def _extra(self) -> Look:
        playback = self.context.playback
        return {
            "title": str(self.context.run.get("pipeline", "")),
            "playback": None if playback is None else {"paused": playback.paused, "rate": playback.rate},
            "drive": self._driven,
            "stop": self._driven or "motion_state" in self._seen,
        }

    def _stop(self, command: dict[str, Any]) -> None:
        if self._hand is not None:
            self._hand.let_go()
        self._control("stop")

    def _rearm(self, command: dict[str, Any]) -> None:
        self._control("rearm")

    def _control(self, action: Literal["stop", "rearm"]) -> None:
        self.context.count(f"{action}_commands")
        self.context.emit("control", MotionControl(stamp=self.context.now(), action=action))

    def _move(self, command: dict[str, Any]) -> None:
        if self._hand is None or not self._driven:
            raise InputError("nothing drives by the stick: add {plugin: teleop-web} to the pipeline")
        self._hand.move(command)

    def _token(self) -> str:
        """Return the configured token, a new one where one is needed, else "" for none."""
        name = self._config.token_file
        if not name:
            return "" if is_local(self._config.host) else secrets.token_urlsafe(16)
        try:
            token = Path(name).read_text(encoding="ascii").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"cannot read the token: {error}", where=name) from error
        if len(token) < 8 or not token.replace("-", "").replace("_", "").isalnum():
            raise InputError("expected a token of at least 8 letters, digits, - and _", where=name)
        return token


def _keep_secret(path: Path, text: str) -> None:
    """Write a file that only its owner can read: a log would be handed on."""
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(text)
    except OSError as error:
        raise KnotworkError(f"cannot keep the page's address: {error.strerror}", where=str(path)) from error
