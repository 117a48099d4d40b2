"""The page's commands to a run that can wait."""

from collections.abc import Callable
from typing import Any

from knotwork.core.contracts import Playback
from knotwork.core.errors import InputError


def playback_commands(playback: Playback) -> dict[str, Callable[[dict[str, Any]], None]]:
    """Return `pause`, `resume`, `step` (by `type`, a message type) and `rate` (a number, or null for the fastest)."""

    def pause(command: dict[str, Any]) -> None:
        playback.pause()

    def resume(command: dict[str, Any]) -> None:
        playback.resume()

    def step(command: dict[str, Any]) -> None:
        kind = command.get("type", "")
        if not isinstance(kind, str):
            raise InputError(f"expected the name of a message type, got {kind!r}")
        playback.step(kind)

    def rate(command: dict[str, Any]) -> None:
        value = command.get("rate")
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float) or not value > 0):
            raise InputError(f"expected a rate above 0 or null, got {value!r}")
        playback.rate = value

    return {"pause": pause, "resume": resume, "step": step, "rate": rate}
