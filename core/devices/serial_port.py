"""A serial port that never blocks for longer than it is told and says when its device has gone."""

import os
import select
from collections.abc import Sequence
from contextlib import suppress

import serial

from knotwork.core.devices.errors import DeviceLost
from knotwork.core.errors import DriverError

_CHUNK = 4096
_MOST = 1 << 16
_WRITE_TIMEOUT = 0.5  # s


class SerialPort:
    """An open port, locked against other programs, 8N1.

    Raises
    ------
    DriverError
        It cannot be opened: missing, not permitted, or taken.
    """

    def __init__(self, path: str, baud: int) -> None:
        self.path = path
        try:
            self._port = serial.Serial(path, baud, timeout=0, write_timeout=_WRITE_TIMEOUT, exclusive=True)
        except (serial.SerialException, OSError, ValueError) as error:
            raise DriverError(_why(path, error), where=path, hint=_hint(error)) from error
        # Only some USB adapters hold bytes back, and only those can be told not to.
        with suppress(ValueError, OSError, NotImplementedError, AttributeError):
            self._port.set_low_latency_mode(True)

    def read(self, timeout: float, also: Sequence[int] = ()) -> bytes:
        """Return what has arrived, waiting up to `timeout` [s] for the first byte; b"" if nothing came.

        Parameters
        ----------
        timeout
        also
            Descriptors that end the wait too.

        Raises
        ------
        DeviceLost
        """
        try:
            descriptor = self._port.fileno()
            ready = select.select([descriptor, *also], [], [], max(timeout, 0.0))[0]
            if descriptor not in ready:
                return b""
            data = os.read(descriptor, _CHUNK)
        except BlockingIOError:
            return b""
        except (OSError, ValueError, serial.SerialException) as error:
            raise DeviceLost(_why(self.path, error)) from error
        if not data:
            raise DeviceLost("unplugged")
        return data

    def read_all(self, timeout: float, also: Sequence[int] = ()) -> bytes:
        """Return all that has arrived, as `read` waits for it; the terminal hands out no more than 4 kB at a time."""
        data = self.read(timeout, also)
        while data and len(data) < _MOST and (more := self.read(0.0)):
            data += more
        return data

    def write(self, data: bytes) -> None:
        """Write all of `data`; raises DeviceLost when the device does not take it."""
        try:
            self._port.write(data)
        except (serial.SerialException, OSError, ValueError) as error:
            raise DeviceLost(_why(self.path, error)) from error

    def flush_input(self) -> int:
        """Drop what has arrived; return how many bytes. Raises DeviceLost."""
        dropped = 0
        while data := self.read(0.0):
            dropped += len(data)
        return dropped

    def close(self) -> None:
        """Close it; a port whose device has gone closes as well."""
        with suppress(OSError, serial.SerialException):
            self._port.close()


def _why(path: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number is not None:
        return {2: "no such device", 5: "unplugged", 11: "in use by another program", 13: "not permitted"}.get(
            number, os.strerror(number)
        )
    return str(error).replace(f"{path}: ", "") or type(error).__name__


def _hint(error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number == 13:
        return "sudo usermod -aG dialout $USER, then log in again; `knotwork doctor` says more"
    return "`knotwork doctor` lists the devices that are there"
