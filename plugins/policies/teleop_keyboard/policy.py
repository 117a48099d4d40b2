"""Keys in, commands out, at a steady rate."""

import os
import select
import sys
import termios
import tty
from collections import deque
from contextlib import suppress
from threading import Thread
from typing import Any

from knotwork.core.contracts import Context, Policy
from knotwork.core.devices.wake import Wake
from knotwork.core.messages import MotionControl, MotionState, Twist
from knotwork.plugins.policies.teleop_keyboard import Config
from knotwork.plugins.policies.teleop_keyboard.keys import HELP, Keys, split


class TeleopKeyboard(Policy):
    """Reads the terminal in a thread of its own; the run's timer sends what the keys have asked for."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        config: Config = context.config
        self._keys = Keys(config)
        self._pressed: deque[str] = deque()
        self._wake = Wake()
        self._thread: Thread | None = None
        self._before: list[Any] | None = None
        self._hung_up = False
        self._descriptor = -1
        context.every(1.0 / config.rate, self._send)

    def open(self) -> None:
        """Take over the terminal's keys, if there is a terminal."""
        try:
            self._descriptor = sys.stdin.fileno()
        except (OSError, ValueError):
            self._descriptor = -1
        if self._descriptor < 0 or not os.isatty(self._descriptor):
            self.context.report("warning", "there is no terminal to read keys from: the robot stands")
            return
        self._before = termios.tcgetattr(self._descriptor)
        tty.setcbreak(self._descriptor)
        self.context.report("info", HELP)
        self._thread = Thread(target=self._read, name="keyboard", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Give the terminal back."""
        self._wake.set()
        if self._thread is not None:
            self._thread.join(1.0)
        if self._before is not None:
            with suppress(termios.error):  # the window may be gone
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)
            self._before = None

    def on_state(self, message: MotionState) -> None:
        """Tell the person why the robot stands, and how to go on."""
        if message.state in ("fault", "emergency"):
            self._keys.stop()
            self.context.report("warning", f"the robot stands ({message.reason}); r re-arms it")
        elif message.state == "ready":
            self.context.report("info", "the robot is ready")

    def _read(self) -> None:
        pending = b""
        while True:
            ready = select.select([self._descriptor, self._wake.fileno()], [], [])[0]
            if self._descriptor not in ready:
                return  # woken: the run has ended
            try:
                data = os.read(self._descriptor, 64)
            except OSError:
                data = b""
            if not data:
                self._hung_up = True  # the window was closed, the connection broke
                return
            names, pending = split(pending + data)
            self._pressed.extend(names)

    def _send(self, time: int) -> None:
        keys = self._keys
        while self._pressed:
            action = keys.press(self._pressed.popleft(), time)
            if action is not None:
                self.context.emit("control", MotionControl(stamp=self.context.now(), action=action))
        if self._hung_up:
            keys.stop()
        v, w = keys.command(time)
        self.context.emit("twist", Twist(stamp=self.context.now(), vx=v, wz=w))
