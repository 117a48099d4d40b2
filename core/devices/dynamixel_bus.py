"""Asks and tells Dynamixel devices on a serial port, one transaction at a time.

ROBOTIS's Python SDK forgets the byte stuffing, waits busily, hides the alert bit in sync reads and stays
"busy" for ever after an exception; this is the one place that does all of it instead.
"""

from collections.abc import Mapping, Sequence

from knotwork.core import clock
from knotwork.core.devices.errors import NoAnswer
from knotwork.core.devices.serial_port import SerialPort
from knotwork.core.protocols import dynamixel
from knotwork.core.protocols.dynamixel import Packet

_PATIENCE = 0.025  # s for an answer; an FTDI adapter may hold it back for 16 ms
_ATTEMPTS = 3
# A request whose length was damaged has the device wait for bytes that never come; these end that.
_FILL = bytes(1024)


class Refused(Exception):
    """A device answered with an error code."""

    def __init__(self, packet: Packet, what: str) -> None:
        name = dynamixel.Error(packet.failure).name if packet.failure <= max(dynamixel.Error) else packet.failure
        super().__init__(f"device {packet.id} refused {what}: {name}")
        self.packet = packet


class LineFigures:
    """Counters of a line over all its connections."""

    def __init__(self) -> None:
        self._bus: DynamixelBus | None = None
        self._past: dict[str, float] = {}

    def attach(self, bus: "DynamixelBus") -> None:
        """Count on with a new connection."""
        self._past = self.summary()
        self._bus = bus

    def summary(self) -> dict[str, float]:
        """Return the counters."""
        bus = self._bus
        if bus is None:
            return self._past
        present = {
            "rejected_packets": bus.parser.rejected,
            "skipped_bytes": bus.parser.skipped,
            "retries": bus.retries,
            "unanswered": bus.failures,
        }
        return {name: value + self._past.get(name, 0) for name, value in present.items()}


class DynamixelBus:
    """Transactions over a port; belongs to one thread.

    Attributes
    ----------
    retries, failures
        Attempts that had to be repeated, transactions given up.
    sent
        When the last request was sent, by `clock.epoch()` [ns].
    alerts
        Ids whose last answer carried the alert bit (hardware error).
    """

    def __init__(self, port: SerialPort) -> None:
        self.port = port
        self.parser = dynamixel.Parser()
        self.retries = self.failures = self.sent = 0
        self.alerts: set[int] = set()

    def ping(self, device: int, patience: float = _PATIENCE) -> tuple[int, int] | None:
        """Return model number and firmware version, None without an answer."""
        try:
            answer = self._ask(dynamixel.ping(device), [device], 3, patience, "ping")[device]
        except NoAnswer:
            return None
        return int.from_bytes(answer.data[:2], "little"), answer.data[2]

    def read(self, device: int, address: int, length: int) -> bytes:
        """Return a block of the control table; raises NoAnswer, Refused, DeviceLost."""
        request = dynamixel.read(device, address, length)
        return self._ask(request, [device], length, _PATIENCE, f"reading {address}")[device].data

    def write(self, device: int, address: int, data: bytes, patience: float | None = None) -> None:
        """Write into the control table and wait for the acknowledgement.

        With `patience` [s] it is asked once and the answer may take that long.

        Raises
        ------
        NoAnswer, Refused, DeviceLost
        """
        request = dynamixel.write(device, address, data)
        what = f"writing {address}"
        if patience is None:
            self._ask(request, [device], 0, _PATIENCE, what)
        else:
            self._ask(request, [device], 0, patience, what, attempts=1)

    def sync_read(self, devices: Sequence[int], address: int, length: int, fast: bool) -> dict[int, bytes]:
        """Return the same block of several devices; `fast` has them answer with one packet."""
        make = dynamixel.fast_sync_read if fast else dynamixel.sync_read
        answers = self._ask(make(devices, address, length), devices, length, _PATIENCE, f"sync read {address}")
        return {device: answers[device].data for device in devices}

    def sync_write(self, address: int, values: Mapping[int, bytes]) -> None:
        """Write the same registers of several devices; nobody answers."""
        self.port.write(dynamixel.sync_write(address, values))
        self.sent = clock.epoch()

    def _ask(
        self,
        request: bytes,
        devices: Sequence[int],
        length: int,
        patience: float,
        what: str,
        attempts: int = _ATTEMPTS,
    ) -> dict[int, Packet]:
        for attempt in range(attempts):
            if attempt > 0:
                self.retries += 1
                self.port.write(_FILL)
            # A late answer to an earlier question must not be taken for this one's.
            self.port.flush_input()
            self.parser.reset()
            self.port.write(request)
            self.sent = clock.epoch()
            answers = self._collect(devices, length, patience)
            if len(answers) == len(devices):
                for packet in answers.values():
                    (self.alerts.add if packet.alert else self.alerts.discard)(packet.id)
                    if packet.failure:
                        raise Refused(packet, what)
                return answers
        self.failures += 1
        raise NoAnswer(f"no answer to {what}")

    def _collect(self, devices: Sequence[int], length: int, patience: float) -> dict[int, Packet]:
        answers: dict[int, Packet] = {}
        until = clock.monotonic() + round(patience * 1e9)
        left = patience
        # Once more after the time is up: what has arrived is an answer, also on a host that has paused meanwhile.
        while len(answers) < len(devices) and left > 0.0:
            left = (until - clock.monotonic()) * 1e-9
            for packet in self.parser.feed(self.port.read(max(left, 0.0))):
                parts = [packet]
                if packet.id == dynamixel.BROADCAST and packet.is_status:
                    parts = dynamixel.split_fast(packet, length)
                for part in parts:
                    fits = part.is_status and part.id in devices
                    if fits and (part.failure or len(part.data) == length):
                        answers[part.id] = part
        return answers
