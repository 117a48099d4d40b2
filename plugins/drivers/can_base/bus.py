"""Frames in and out, without python-can's Notifier, whose thread dies silently."""

import select
from typing import Any

import can

from knotwork.core.devices.errors import DeviceLost
from knotwork.core.devices.wake import Wake
from knotwork.core.errors import DriverError
from knotwork.core.protocols import agilex
from knotwork.core.protocols.agilex import Frame
from knotwork.plugins.drivers.can_base import Config

_POLL = 0.005  # s between looks at an interface that cannot be waited for


class CanBus:
    """An open bus.

    Raises
    ------
    DriverError
        It cannot be opened.

    Attributes
    ----------
    decoder
        Counts frames.
    error_frames
        Frames by which the controller reports trouble on the bus.
    """

    def __init__(self, config: Config) -> None:
        options: dict[str, Any] = {}
        if config.interface == "udp_multicast":
            options["port"] = config.udp_port
        elif config.interface not in ("virtual", "socketcan"):  # the kernel's own is set with `ip link`
            options["bitrate"] = config.bitrate
        where = f"{config.interface} {config.channel}"
        try:
            self._bus: Any = can.Bus(interface=config.interface, channel=config.channel, **options)
        except (can.CanError, OSError, ValueError, NotImplementedError, ImportError) as error:
            hint = "is it an interface of python-can, and is this one of its channels?"
            if config.interface == "socketcan":
                hint = f"sudo ip link set {config.channel} up type can bitrate {config.bitrate}"
            raise DriverError(f"cannot open the CAN bus: {error}", where=where, hint=hint) from error
        self.decoder = agilex.Decoder()
        self.error_frames = 0
        try:
            self._descriptor = int(self._bus.fileno())
        except NotImplementedError:
            self._descriptor = -1

    def wait(self, seconds: float, wake: Wake) -> bool:
        """Wait for a frame, for `wake`, or so long; return whether it was `wake`."""
        if self._descriptor < 0:
            return wake.wait(min(seconds, _POLL))
        try:
            ready = select.select([self._descriptor, wake.fileno()], [], [], max(seconds, 0.0))[0]
        except OSError as error:
            raise DeviceLost(str(error)) from error
        if wake.fileno() not in ready:
            return False
        wake.clear()
        return True

    def frame(self) -> tuple[bool, Frame | None]:
        """Return whether a frame had arrived, and it if it is understood; never waits."""
        try:
            message = self._bus.recv(0.0)
        except (can.CanError, OSError) as error:
            raise DeviceLost(str(error)) from error
        if message is None:
            return False, None
        if message.is_error_frame:
            self.error_frames += 1
            return True, None
        if message.is_extended_id or message.is_remote_frame:
            return True, None
        return True, self.decoder.decode(message.arbitration_id, message.data)

    def send(self, name: str, **signals: float) -> None:
        """Send a message of the protocol; raises DeviceLost."""
        identifier, data = agilex.encode(name, **signals)
        try:
            self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False), timeout=0.05)
        except (can.CanError, OSError) as error:
            raise DeviceLost(str(error)) from error

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()
