"""Drivers alone, with a stand-in for the runtime, against the emulated devices."""

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from knotwork.core.clock import epoch
from knotwork.core.contracts import Driver
from knotwork.core.messages import Message, MotionControl, Twist
from knotwork.core.registry import Registry

PATIENCE = 20.0  # s; a loaded machine is slow, not wrong


class Probe:
    """The context of one driver; keeps what it gives."""

    def __init__(self, plugin: str, out: Path, uses: dict[str, object] | None = None, **config: object) -> None:
        manifest = Registry(third_parties=False).find(plugin)
        assert manifest is not None
        self.name = plugin
        self.config = manifest.config(**config)
        self.options = None
        self.uses = {"lidar": None} | (uses or {})
        self.out = out
        self.seed = 0
        self.run: dict[str, object] = {}
        self.given: dict[str, list[Message]] = {}
        self.lines: list[str] = []
        self.counts: dict[str, int] = {}
        self.timers: list[Callable[[int], None]] = []
        self.driver: Driver = Registry().load(manifest)(self)

    def emit(self, port: str, message: Message) -> None:
        self.given.setdefault(port, []).append(message)

    def now(self) -> int:
        return epoch()

    def every(self, period: float, call: Callable[[int], None]) -> None:
        self.timers.append(call)

    def report(self, level: str, text: str) -> None:
        self.lines.append(text)

    def count(self, name: str, by: int = 1) -> None:
        self.counts[name] = self.counts.get(name, 0) + by

    def __enter__(self) -> "Probe":
        try:
            self.driver.open()
        except BaseException:
            self.driver.close()
            raise
        self.driver.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.driver.stop_motion()
        self.driver.stop()
        self.driver.close()
        for timer in self.timers:
            timer(0)  # raises what went wrong in the thread

    def last(self, port: str) -> Message:
        self.until(lambda: self.given.get(port))
        return self.given[port][-1]

    def fresh(self, port: str, n: int = 1) -> Message:
        """Wait for `n` more messages of a port."""
        have = len(self.given.get(port, ()))
        self.until(lambda: len(self.given.get(port, ())) >= have + n)
        return self.given[port][-1]

    def until(self, condition: Callable[[], object]) -> None:
        give_up = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < give_up, self.lines
            time.sleep(0.01)

    def rearm(self) -> None:
        self.driver.on_control(MotionControl(stamp=epoch(), action="rearm"))


class Drive:
    """Repeats a command as a policy does."""

    def __init__(self, probe: Probe, v: float, w: float) -> None:
        self._command = (v, w)
        self._probe = probe
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)

    def _work(self) -> None:
        v, w = self._command
        while not self._end.wait(0.02):
            self._probe.driver.on_twist(Twist(stamp=epoch(), vx=v, wz=w))

    def __enter__(self) -> "Drive":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()


@pytest.fixture
def rig(tmp_path):
    """Return a function that builds a driver's probe, and enters it until the test ends."""
    with ExitStack() as stack:

        def build(plugin: str, uses: dict[str, object] | None = None, **config: object) -> Probe:
            return stack.enter_context(Probe(plugin, tmp_path, uses, **config))

        build.enter = stack.enter_context
        build.drive = lambda probe, v, w=0.0: stack.enter_context(Drive(probe, v, w))
        yield build
