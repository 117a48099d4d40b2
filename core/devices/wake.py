"""A way to interrupt a thread that waits for a device, safe from any thread and from a signal handler."""

import os
import select
from contextlib import suppress


class Wake:
    """A pipe to itself: `set` ends the wait of the thread that waits."""

    def __init__(self) -> None:
        self._read, self._write = os.pipe()
        os.set_blocking(self._read, False)
        os.set_blocking(self._write, False)

    def fileno(self) -> int:
        """Return what `select` waits for."""
        return self._read

    def set(self) -> None:
        """End the wait, or the next one."""
        with suppress(BlockingIOError):  # it is set more than enough
            os.write(self._write, b"x")

    def clear(self) -> None:
        """Make the next wait last."""
        with suppress(BlockingIOError):
            while os.read(self._read, 4096):
                pass

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s]; return whether it was set, and clear it."""
        if not select.select([self._read], [], [], max(timeout, 0.0))[0]:
            return False
        self.clear()
        return True

    def __del__(self) -> None:
        """Release the pipe with the last thread that may wait or set."""
        os.close(self._read)
        os.close(self._write)
