"""The thread an emulated robot lives in: waits for bytes and for the next deadline, and never spins."""

import os
import queue
import select
import threading
from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from knotwork.core.clock import epoch
from knotwork.core.emulator.line import Line

T = TypeVar("T")

_IDLE = 20_000_000  # ns; longest wait
_LOOK = 2_000_000  # ns between looks at whether a client has come to a closed line


class Device(Protocol):
    """Something at the end of a line."""

    line: Line

    def next_due(self) -> int | None:
        """Return when it does something by itself [ns]; None: never."""

    def receive(self, data: bytes, now: int) -> None:
        """Take bytes from the host."""

    def run(self, now: int) -> None:
        """Do what is due."""


class Loop:
    """Runs devices in real time.

    Parameters
    ----------
    devices
        On serial lines.
    advance
        Called first at each wake-up with the time [ns since 1970]; returns when it wants to be called
        again at the latest.
    """

    def __init__(self, devices: Sequence[Device], advance: Callable[[int], int]) -> None:
        self._devices = devices
        self._advance = advance
        self._calls: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._wake_read, self._wake_write = os.pipe()
        os.set_blocking(self._wake_read, False)
        self._stopping = False
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="emulator", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End; raises what ended the loop if it was an error."""
        if self._thread.is_alive():
            self._stopping = True
            os.write(self._wake_write, b"\0")
            self._thread.join()
        if self._wake_read >= 0:
            os.close(self._wake_read)
            os.close(self._wake_write)
            self._wake_read = self._wake_write = -1
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self._thread.is_alive()

    def call(self, function: Callable[[], T]) -> T:
        """Run a function in the loop's thread between two events, and wait for its result."""
        if not self._thread.is_alive() or threading.current_thread() is self._thread:
            return function()
        done = threading.Event()
        result: list[T] = []

        def work() -> None:
            try:
                result.append(function())
            finally:
                done.set()

        self._calls.put(work)
        os.write(self._wake_write, b"\0")
        while not done.wait(0.1):
            if not self._thread.is_alive():
                raise RuntimeError("the emulator has stopped")
        return result[0]

    def _run(self) -> None:
        try:
            self._live()
        except BaseException as error:  # noqa: BLE001  given to whoever stops the loop
            self._failure = error

    def _live(self) -> None:
        poll = select.poll()
        poll.register(self._wake_read, select.POLLIN)
        watched: dict[int, Device] = {}
        look = 0
        while not self._stopping:
            now = epoch()
            if now >= look:
                look = now + _LOOK
                self._watch(poll, watched)
            due = min(self._advance(now), now + _IDLE)
            for device in self._devices:
                device.line.flush(now)
                device.run(now)
                for time in (device.next_due(), device.line.next_due()):
                    if time is not None:
                        due = min(due, time)
            wait = max(0, due - epoch())
            for descriptor, event in poll.poll(-(-wait // 1_000_000)):
                if descriptor == self._wake_read:
                    self._serve()
                    look = 0  # a line may have been plugged or unplugged
                elif event & select.POLLIN:
                    now = epoch()
                    self._advance(now)
                    device = watched[descriptor]
                    device.receive(device.line.read(), now)
                else:  # nobody has it open: it would wake us for ever
                    poll.unregister(descriptor)
                    del watched[descriptor]

    def _watch(self, poll: select.poll, watched: dict[int, Device]) -> None:
        there = {d.line.descriptor: d for d in self._devices if not d.line.deserted()}
        for gone in watched.keys() - there.keys():
            poll.unregister(gone)
            del watched[gone]
        for new in there.keys() - watched.keys():
            poll.register(new, select.POLLIN)
            watched[new] = there[new]

    def _serve(self) -> None:
        os.read(self._wake_read, 4096)
        while not self._calls.empty():
            self._calls.get()()
