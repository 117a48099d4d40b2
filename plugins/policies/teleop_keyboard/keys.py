"""What the keys mean."""

from typing import Literal

from knotwork.plugins.policies.teleop_keyboard import Config

HELP = "keys: w/x faster/slower, a/d left/right (or arrows), s or space stop, e emergency stop, r re-arm, Ctrl-C end"

_ARROWS = {b"A": "w", b"B": "x", b"C": "d", b"D": "a"}


class Keys:
    """Speeds that grow and fall by a step a key, and fall to zero when no key comes for a while."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._v = self._w = 0.0
        self._last = 0  # ns

    def press(self, key: str, now: int) -> Literal["stop", "rearm"] | None:
        """Take a key at `now` [ns]; return what the base must be told besides its speeds."""
        config = self._config
        self.command(now)  # what has run out must not be built upon
        self._last = now
        if key in ("w", "x"):
            step = config.speed_step if key == "w" else -config.speed_step
            self._v = min(max(self._v + step, -config.speed), config.speed)
        elif key in ("a", "d"):
            step = config.yaw_rate_step if key == "a" else -config.yaw_rate_step
            self._w = min(max(self._w + step, -config.yaw_rate), config.yaw_rate)
        elif key in ("s", " "):
            self.stop()
        elif key == "e":
            self.stop()
            return "stop"
        elif key == "r":
            self.stop()
            return "rearm"
        return None

    def stop(self) -> None:
        """Stand."""
        self._v = self._w = 0.0

    def command(self, now: int) -> tuple[float, float]:
        """Return forward speed [m/s] and yaw rate [rad/s] at `now` [ns]."""
        if self._config.hold and now - self._last > self._config.hold * 1e9:
            self.stop()
        # A sum of steps is not exactly zero after as many steps back.
        return round(self._v, 9), round(self._w, 9)


def split(data: bytes) -> tuple[list[str], bytes]:
    """Split what a terminal sent into keys; arrows become letters; an unfinished sequence is handed back."""
    keys = []
    at = 0
    while at < len(data):
        if data[at] != 0x1B:
            keys.append(chr(data[at]).lower())
            at += 1
        elif data[at : at + 2] in (b"\x1b[", b"\x1bO"):
            if at + 2 >= len(data):
                return keys, data[at:]
            letter = data[at + 2 : at + 3]
            keys += [_ARROWS[letter]] if letter in _ARROWS else []
            at += 3
        elif at + 1 == len(data):
            return keys, data[at:]
        else:
            at += 1
    return keys, b""
