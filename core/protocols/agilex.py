"""AgileX protocol v2 on CAN: messages as the DBC file beside this module lays them out.

Needs the extra `can` (cantools).
"""

from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import cantools

BITRATE = 500_000
COMMAND_PERIOD = 0.02  # s
COMMAND_TIMEOUT = 0.5  # s; the base stops by itself after that
STANDBY, CAN, UART, REMOTE = range(4)  # control modes
NORMAL, EMERGENCY_STOP, EXCEPTION = range(3)  # vehicle states

_LIMIT = 32.767  # m/s and rad/s, of a motion command


class Frame(NamedTuple):
    """A decoded frame: name of the message, signals in SI units (V, A, m/s, rad/s, m)."""

    name: str
    signals: dict[str, float]


@cache
def database() -> Any:
    """Return the messages, a `cantools.database.Database`."""
    text = (files("knotwork.core.protocols") / "agilex_v2.dbc").read_text(encoding="ascii")
    return cantools.database.load_string(text, database_format="dbc")


def encode(name: str, **signals: float) -> tuple[int, bytes]:
    """Return identifier and payload of a message; signals left out are 0, values are clamped to their range.

    Raises
    ------
    KeyError
        No such message or signal.
    """
    message = database().get_message_by_name(name)
    values = {signal.name: 0.0 for signal in message.signals}
    for key, value in signals.items():
        signal = message.get_signal_by_name(key)
        values[key] = min(max(value, signal.minimum), signal.maximum)
    payload: bytes = message.encode(values, strict=False)
    return message.frame_id, payload


def motion_command(v: float, w: float) -> tuple[int, bytes]:
    """Return the frame for forward speed [m/s] and yaw rate [rad/s]."""
    return encode("MotionCommand", linear=v, angular=w)


class Decoder:
    """Takes frames apart; what the DBC does not know or what is too short is counted, never raised.

    Attributes
    ----------
    received, packets, rejected, unknown
        Frames seen, decoded, too short for their message, and of other identifiers.
    """

    def __init__(self) -> None:
        self.received = self.packets = self.rejected = self.unknown = 0
        self._messages = {message.frame_id: message for message in database().messages}

    def decode(self, identifier: int, data: bytes | bytearray) -> Frame | None:
        """Return the frame, or None if it is not understood; a longer payload than the DBC's is cut."""
        self.received += 1
        message = self._messages.get(identifier)
        if message is None:
            self.unknown += 1
            return None
        if len(data) < message.length:
            self.rejected += 1
            return None
        signals = message.decode(bytes(data[: message.length]), decode_choices=False)
        self.packets += 1
        return Frame(message.name, signals)
