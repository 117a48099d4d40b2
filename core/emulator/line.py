"""A serial line as the kernel shows it: a pseudo-terminal that can be noisy, slow, silent or unplugged."""

import contextlib
import errno
import os
import select
import tty
from collections import deque
from pathlib import Path

import numpy as np

_CHUNK = 64  # bytes of a USB packet


class Noise:
    """Drops bytes and flips bits.

    Attributes
    ----------
    drop
        Probability for each byte to be lost.
    flip
        Probability for each bit to be inverted.
    dropped, flipped
        What it has done so far.
    """

    def __init__(self, random: np.random.Generator, drop: float = 0.0, flip: float = 0.0) -> None:
        self.drop, self.flip = drop, flip
        self.dropped = self.flipped = 0
        self._random = random

    def apply(self, data: bytes) -> bytes:
        """Return what is left of `data`."""
        if not data or (self.drop <= 0.0 and self.flip <= 0.0):
            return data
        array = np.frombuffer(data, dtype=np.uint8)
        if self.drop > 0.0:
            array = array[self._random.random(len(array)) >= self.drop]
            self.dropped += len(data) - len(array)
        if self.flip > 0.0:
            bits = self._random.random((len(array), 8)) < self.flip
            self.flipped += int(bits.sum())
            array = array ^ np.packbits(bits, axis=1).reshape(-1)
        return array.tobytes()


class Line:
    """The device's end of a serial line.

    The client opens `link`, a symbolic link to a pseudo-terminal as udev makes it under
    /dev/serial/by-id. What is sent while no client has it open is lost, as on a real line.

    Parameters
    ----------
    link
        Where to put the symbolic link; its folder must exist.
    random
        Of noise and delays.

    Attributes
    ----------
    noise
        On both directions.
    stalled
        All bytes are lost, both ways, while the device stays plugged in.
    latency
        Longest delay of each 64 bytes sent [s]; 0: at once.
    sent, received, overrun
        Bytes that went out, that came in, and that found the client's buffer full.
    """

    def __init__(self, link: Path, random: np.random.Generator) -> None:
        self.link = link
        self.noise = Noise(random)
        self.stalled = False
        self.latency = 0.0
        self.sent = self.received = self.overrun = 0
        self._random = random
        self._master = -1
        self._poll = select.poll()
        self._next: tuple[int, int] | None = None
        self._queue: deque[tuple[int, bytes]] = deque()
        self.plug()

    @property
    def plugged(self) -> bool:
        """Whether the device is there."""
        return self._master >= 0

    @property
    def descriptor(self) -> int:
        """File descriptor to wait on; -1 while unplugged."""
        return self._master

    def plug(self) -> None:
        """Make the terminal, under another name than the last one, and the link to it."""
        if self.plugged:
            return
        master, slave = self._next or os.openpty()
        self._next = None
        name = os.ttyname(slave)
        tty.setraw(slave)  # until the client does it: else what it has not yet read is echoed
        os.set_blocking(master, False)
        os.close(slave)
        self._master = master
        self._poll = select.poll()
        self._poll.register(master, select.POLLIN)
        temporary = self.link.with_name(self.link.name + ".new")
        temporary.unlink(missing_ok=True)
        temporary.symlink_to(name)
        temporary.replace(self.link)

    def unplug(self) -> None:
        """Take the device away: the client's terminal hangs up, the link is gone."""
        if not self.plugged:
            return
        self.link.unlink(missing_ok=True)
        # Taken while the old one still holds its number: the device comes back under another name.
        self._next = os.openpty()
        os.close(self._master)
        self._master = -1
        self._queue.clear()

    def close(self) -> None:
        """Unplug for good."""
        self.unplug()
        for descriptor in self._next or ():
            os.close(descriptor)
        self._next = None

    def connected(self) -> bool:
        """Whether a client has the line open."""
        return self.plugged and not any(event & select.POLLHUP for _, event in self._poll.poll(0))

    def deserted(self) -> bool:
        """Whether no client has the line open and none has left bytes in it."""
        return not self.plugged or any(
            event & select.POLLHUP and not event & select.POLLIN for _, event in self._poll.poll(0)
        )

    def read(self) -> bytes:
        """Return what the client has sent, or had sent before it went."""
        if not self.plugged:
            return b""
        try:
            data = os.read(self._master, 4096)
        except OSError as error:
            if error.errno in (errno.EIO, errno.EAGAIN):  # no client; nothing there
                return b""
            raise
        self.received += len(data)
        return b"" if self.stalled else self.noise.apply(data)

    def send(self, data: bytes, now: int) -> None:
        """Send to the client, at `now` [ns] or with the line's latency."""
        if not self.plugged or self.stalled:
            return
        data = self.noise.apply(data)
        if self.latency <= 0.0 and not self._queue:
            self._write(data)
            return
        due = max(now, self._queue[-1][0] if self._queue else 0)
        for at in range(0, len(data), _CHUNK):
            due += round(self.latency * self._random.random() * 1e9)
            self._queue.append((due, data[at : at + _CHUNK]))

    def next_due(self) -> int | None:
        """Return when delayed bytes are to go out [ns]."""
        return self._queue[0][0] if self._queue else None

    def flush(self, now: int) -> None:
        """Send the delayed bytes that are due."""
        while self._queue and self._queue[0][0] <= now:
            self._write(self._queue.popleft()[1])

    def _write(self, data: bytes) -> None:
        if not data or not self.connected():
            return
        written = 0
        with contextlib.suppress(BlockingIOError):
            written = os.write(self._master, data)
        self.sent += written
        self.overrun += len(data) - written
