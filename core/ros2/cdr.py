"""CDR, the form in which ROS 2 messages travel: OMG DDSI-RTPS, PLAIN_CDR, little-endian.

Four bytes say so; then each number stands at a multiple of its size, counted from there. A text or a
sequence begins with its length (uint32); a text's counts its closing zero.
"""

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.errors import InputError

_LITTLE = b"\x00\x01\x00\x00"


class Writer:
    """Puts one message together."""

    def __init__(self) -> None:
        self._data = bytearray(_LITTLE)

    def number(self, kind: str, *values: float) -> None:
        """Append numbers of one `struct` kind ("d", "f", "I", "i", "b")."""
        size = struct.calcsize(kind)
        self._align(size)
        self._data += struct.pack(f"<{len(values)}{kind}", *values)

    def text(self, value: str) -> None:
        """Append a text."""
        data = value.encode() + b"\0"
        self.number("I", len(data))
        self._data += data

    def array(self, values: NDArray[Any], dtype: str) -> None:
        """Append a sequence of numbers of a little-endian dtype ("<f4", "i1")."""
        data = np.ascontiguousarray(values, dtype)
        self.number("I", data.size)
        if data.size:
            self._align(data.itemsize)
        self._data += data.tobytes()

    def done(self) -> bytes:
        """Return the message."""
        return bytes(self._data)

    def _align(self, size: int) -> None:
        self._data += bytes(-(len(self._data) - 4) % size)


class Reader:
    """Takes one message apart; every method raises InputError when the data ends too early."""

    def __init__(self, data: bytes) -> None:
        if len(data) < 4 or data[:2] not in (b"\x00\x01", b"\x00\x00"):
            raise InputError("not a CDR message")
        self._order = "<" if data[1] else ">"
        self._data = data
        self._at = 4

    def numbers(self, kind: str, count: int = 1) -> tuple[Any, ...]:
        """Return numbers of one `struct` kind."""
        size = struct.calcsize(f"={kind}")
        self._align(size)
        end = self._at + count * size
        if end > len(self._data):
            raise InputError("the CDR message is cut short")
        values = struct.unpack_from(f"{self._order}{count}{kind}", self._data, self._at)
        self._at = end
        return values

    def text(self) -> str:
        """Return a text."""
        (length,) = self.numbers("I")
        if self._at + length > len(self._data):
            raise InputError("the CDR message is cut short")
        data = self._data[self._at : self._at + length]
        self._at += length
        return data.rstrip(b"\0").decode(errors="replace")

    def array(self, kind: str) -> NDArray[Any]:
        """Return a sequence of numbers of a NumPy kind ("f4", "i1")."""
        (count,) = self.numbers("I")
        dtype = np.dtype(self._order + kind)
        if count:
            self._align(dtype.itemsize)
        if self._at + count * dtype.itemsize > len(self._data):
            raise InputError("the CDR message is cut short")
        values = np.frombuffer(self._data, dtype, count, self._at)
        self._at += count * dtype.itemsize
        return values.astype(dtype.newbyteorder("="))

    def _align(self, size: int) -> None:
        self._at += -(self._at - 4) % size
