"""The command."""

import argparse
import secrets
import sys
from pathlib import Path
from threading import Thread
from typing import Any

from knotwork.core.contracts import Command
from knotwork.core.errors import InputError
from knotwork.core.live.playback import playback_commands
from knotwork.core.live.server import LiveServer, is_local
from knotwork.core.registry import Registry
from knotwork.plugins.commands.view.player import Player


class View(Command):
    """Serves the page of the sink `live` for a recorded run."""

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add FILE, --host, --port, --rate, --paused."""
        parser.add_argument("file", metavar="FILE", help="log that the sink `mcap` wrote")
        parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: this machine only)")
        parser.add_argument("--port", type=int, default=8420, help="port to listen on, 0 for a free one (default 8420)")
        parser.add_argument("--rate", default="1", metavar="max|N", help="speed at the start (default 1)")
        parser.add_argument("--paused", action="store_true", help="wait for the play button")

    def run(self, arguments: argparse.Namespace) -> int:
        """Play until Ctrl-C; returns 0."""
        Registry().records()  # the message types that plugins add
        player = Player(Path(arguments.file), _rate(arguments.rate))
        if arguments.paused:
            player.playback.pause()
        commands = playback_commands(player.playback) | {"seek": lambda command: player.seek(_place(command))}
        token = "" if is_local(arguments.host) else secrets.token_urlsafe(16)
        server = LiveServer(player.scene, commands, host=arguments.host, port=arguments.port, token=token)
        player.refresh = server.viewers.refresh
        server.start()
        sys.stderr.write(f"{arguments.file} at {server.address_with_token} (Ctrl-C ends)\n")
        failed: list[Exception] = []
        thread = Thread(target=_play, args=(player, failed), name="player", daemon=True)
        thread.start()
        try:
            while thread.is_alive():
                thread.join(1.0)
        except KeyboardInterrupt:
            sys.stderr.write("\n")
        finally:
            player.stop()
            thread.join(5.0)
            server.stop()
        if failed:
            raise failed[0]
        return 0


def _play(player: Player, failed: list[Exception]) -> None:
    try:
        player.play()
    except Exception as error:  # noqa: BLE001 - raised again in the thread that can show it
        failed.append(error)


def _rate(text: str) -> float | None:
    if text == "max":
        return None
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not 0 < rate < float("inf"):
        raise InputError(f"expected `max` or a number above 0, got {text!r}", where="--rate")
    return rate


def _place(command: dict[str, Any]) -> float:
    place = command.get("place")
    if isinstance(place, bool) or not isinstance(place, int | float) or not 0 <= place <= 1:
        raise InputError(f"expected a place within [0, 1], got {place!r}")
    return float(place)
