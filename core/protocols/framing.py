"""Finds packets in a dirty stream of bytes: any chunking, one packet lost per fault, never an exception."""

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

P = TypeVar("P")


class StreamParser(ABC, Generic[P]):
    """An incremental parser; a subclass knows one packet format.

    A candidate starts at the header. If its checksum or its fields are wrong, only its first byte is
    given up and the search goes on inside it, so that a lost byte costs the packet it was lost from.

    Attributes
    ----------
    received
        Bytes fed so far.
    packets
        Packets accepted.
    rejected
        Candidates refused: wrong checksum, length or fields. Noise that looks like a header counts too.
    skipped
        Bytes that belong to no accepted packet.
    """

    header: bytes

    def __init__(self) -> None:
        self.received = self.packets = self.rejected = self.skipped = 0
        self._buffer = bytearray()

    def feed(self, data: bytes | bytearray | memoryview) -> list[P]:
        """Take more bytes; return the packets they complete, in order."""
        buffer = self._buffer
        buffer += data
        self.received += len(data)
        first = self.received - len(buffer)  # position of buffer[0] in the stream
        found: list[P] = []
        done = 0  # bytes of the buffer that are dealt with
        size = len(buffer)
        while True:
            start = buffer.find(self.header, done)
            if start < 0:
                start = self._partial_header(done)
                self.skipped += start - done
                done = start
                break
            self.skipped += start - done
            done = start
            length = self._length(buffer, start)
            if length > 0:
                end = start + length
                if end > size:
                    break
                packet = self._decode(buffer, start, end, first + end)
                if packet is not None:
                    found.append(packet)
                    done = end
                    continue
            elif length == 0:
                break
            self.rejected += 1
            self.skipped += 1
            done = start + 1
        if done:
            del buffer[:done]
        self.packets += len(found)
        return found

    def reset(self) -> None:
        """Give up an unfinished packet, after a time-out or at a new connection."""
        self.skipped += len(self._buffer)
        self._buffer.clear()

    def _partial_header(self, done: int) -> int:
        """Return where a header that the buffer's end cuts off may start; the buffer's end if nowhere."""
        size = len(self._buffer)
        for start in range(max(done, size - len(self.header) + 1), size):
            if self.header.startswith(self._buffer[start:]):
                return start
        return size

    @abstractmethod
    def _length(self, buffer: bytearray, start: int) -> int:
        """Return the length of the packet at `start`; 0: not known yet, -1: there is no packet."""

    @abstractmethod
    def _decode(self, buffer: bytearray, start: int, end: int, position: int) -> P | None:
        """Return the packet buffer[start:end], whose last byte ends at `position` of the stream; None: bad."""
