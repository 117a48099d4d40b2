"""What the bytes of a joystick device mean: struct js_event of linux/joystick.h."""

import struct
from typing import Literal

from knotwork.plugins.policies.teleop_gamepad import Config

EVENT = struct.Struct("=IhBB")  # time [ms], value, type, number
BUTTON, AXIS = 1, 2
INITIAL = 0x80  # set in the events that tell the state at opening
FULL = 32767

Action = Literal["stop", "rearm"]


class Pad:
    """State of stick and buttons.

    The robot moves only while the hold button is down, and only if it has been up since the last time that the
    robot had to stop.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._pending = b""
        self._axes: dict[int, float] = {}
        self._held = False

    def feed(self, data: bytes) -> list[Action]:
        """Take bytes of the device; return what the base must be told besides its speeds."""
        config = self._config
        data = self._pending + data
        whole = len(data) - len(data) % EVENT.size
        self._pending = data[whole:]
        actions: list[Action] = []
        for _, value, kind, number in EVENT.iter_unpack(data[:whole]):
            if kind & ~INITIAL == AXIS:
                self._axes[number] = max(value / FULL, -1.0)
            elif kind == BUTTON and number == config.hold:
                self._held = value != 0
            elif kind == BUTTON and value and number == config.stop:
                self.let_go()
                actions.append("stop")
            elif kind == BUTTON and value and number == config.rearm:
                self.let_go()
                actions.append("rearm")
        return actions

    def let_go(self) -> None:
        """Take the hold button for released until it is pressed again."""
        self._held = False

    def unplug(self) -> None:
        """Forget everything."""
        self._pending = b""
        self._axes.clear()
        self._held = False

    def command(self) -> tuple[float, float]:
        """Return forward speed [m/s] and yaw rate [rad/s]."""
        if not self._held:
            return 0.0, 0.0
        config = self._config
        return -self._stick(config.forward) * config.speed, -self._stick(config.turn) * config.yaw_rate

    def _stick(self, axis: int) -> float:
        value, dead = self._axes.get(axis, 0.0), self._config.dead_zone
        beyond = max(abs(value) - dead, 0.0) / (1.0 - dead)
        return beyond if value > 0.0 else -beyond
