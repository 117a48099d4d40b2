"""The pad in, commands out, at a steady rate."""

import os
import select
from collections import deque
from threading import Thread

from knotwork.core.contracts import Context, Policy
from knotwork.core.devices.backoff import Backoff
from knotwork.core.devices.wake import Wake
from knotwork.core.messages import MotionControl, MotionState, Twist
from knotwork.plugins.policies.teleop_gamepad import Config
from knotwork.plugins.policies.teleop_gamepad.pad import EVENT, Action, Pad


class TeleopGamepad(Policy):
    """Reads the device in a thread of its own; a pad that is not there is waited for, and the robot stands."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        config: Config = context.config
        self._path = config.device
        self._pad = Pad(config)
        self._actions: deque[Action] = deque()
        self._wake = Wake()
        self._ended = False
        self._thread: Thread | None = None
        context.every(1.0 / config.rate, self._send)

    def open(self) -> None:
        """Start to read."""
        self._thread = Thread(target=self._run, name="gamepad", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._ended = True
        self._wake.set()
        if self._thread is not None:
            self._thread.join(1.0)

    def on_state(self, message: MotionState) -> None:
        """Tell the person why the robot stands, and how to go on."""
        if message.state in ("fault", "emergency"):
            self._pad.let_go()
            self.context.report("warning", f"the robot stands ({message.reason}); the re-arm button re-arms it")
        elif message.state == "ready":
            self.context.report("info", "the robot is ready: hold the hold button and use the stick")

    def _run(self) -> None:
        backoff = Backoff()
        told = False
        while not self._ended:
            try:
                descriptor = os.open(self._path, os.O_RDONLY | os.O_NONBLOCK)
            except OSError as error:
                if not told:
                    why = f"{self._path}: {error.strerror}"
                    self.context.report("warning", f"no gamepad ({why}): the robot stands until there is one")
                    told = True
            else:
                told = False
                backoff.reset()
                self.context.report("info", f"gamepad at {self._path}")
                self._listen(descriptor)
                os.close(descriptor)
                self._pad.unplug()
                if not self._ended:
                    self.context.count("lost")
                    self.context.report("warning", "the gamepad is gone: the robot stands")
            self._wake.wait(backoff.delay())

    def _listen(self, descriptor: int) -> None:
        """Take events until the device goes or the run ends."""
        while not self._ended:
            ready = select.select([descriptor, self._wake.fileno()], [], [])[0]
            if descriptor not in ready:
                return
            try:
                data = os.read(descriptor, 64 * EVENT.size)
            except BlockingIOError:
                continue
            except OSError:
                return
            if not data:
                return
            self._actions.extend(self._pad.feed(data))

    def _send(self, time: int) -> None:
        while self._actions:
            self.context.emit("control", MotionControl(stamp=self.context.now(), action=self._actions.popleft()))
        v, w = self._pad.command()
        self.context.emit("twist", Twist(stamp=self.context.now(), vx=v, wz=w))
