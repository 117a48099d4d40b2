"""How a message travels: its lossless binary form, with a head beside it."""

import struct
from typing import NamedTuple

from knotwork.core.errors import InputError

_HEAD = struct.Struct("<QQQq")
_ACK = struct.Struct("<QQ?")
_PING = struct.Struct("<Qq")
_PONG = struct.Struct("<QQqq")
COMMANDS = frozenset({"twist", "camera_twist"})  # only the newest counts; never sent again


class Head(NamedTuple):
    """What stands beside a message.

    Attributes
    ----------
    session
        Number of the sender's process.
    seq
        Of the message; commands are counted apart.
    first
        The oldest message that the sender still has.
    given
        When the sender was given it, by the sender's clock [ns]; the same each time it is sent.
    type
        Its message type.
    """

    session: int
    seq: int
    first: int
    given: int
    type: str

    def pack(self) -> bytes:
        """Return bytes."""
        return _HEAD.pack(self.session, self.seq, self.first, self.given) + self.type.encode()

    @classmethod
    def unpack(cls, data: bytes) -> "Head":
        """Return the head in `data`; raises InputError when it is none."""
        try:
            session, seq, first, given = _HEAD.unpack_from(data)
            return cls(session, seq, first, given, data[_HEAD.size :].decode())
        except (struct.error, UnicodeDecodeError) as error:
            raise InputError("not a message of this link") from error


class Ack(NamedTuple):
    """The receiver has everything before `expected`; `gap`: something in between is missing."""

    session: int
    expected: int
    gap: bool

    def pack(self) -> bytes:
        """Return bytes."""
        return _ACK.pack(*self)

    @classmethod
    def unpack(cls, data: bytes) -> "Ack":
        """Return the acknowledgement in `data`; raises InputError when it is none."""
        session, expected, gap = _unpack(_ACK, data)
        return cls(session, expected, bool(gap))


class Ping(NamedTuple):
    """`asker` asked at `left` by its clock [ns]."""

    asker: int
    left: int

    def pack(self) -> bytes:
        """Return bytes."""
        return _PING.pack(*self)

    @classmethod
    def unpack(cls, data: bytes) -> "Ping":
        """Return the ping in `data`; raises InputError when it is none."""
        return cls(*_unpack(_PING, data))


class Pong(NamedTuple):
    """The answer to a ping: by whom, and at what time of its clock [ns]."""

    session: int
    asker: int
    left: int
    answered: int

    def pack(self) -> bytes:
        """Return bytes."""
        return _PONG.pack(*self)

    @classmethod
    def unpack(cls, data: bytes) -> "Pong":
        """Return the pong in `data`; raises InputError when it is none."""
        return cls(*_unpack(_PONG, data))


def _unpack(layout: struct.Struct, data: bytes) -> tuple[int, ...]:
    try:
        return layout.unpack(data)
    except struct.error as error:
        raise InputError("not a message of this link") from error


def base(link: str) -> str:
    """Return the key under which everything of a link travels."""
    return f"knotwork/{link}"


def data_key(link: str, stream: str) -> str:
    """Return the key of a stream `node.port`."""
    return f"{base(link)}/data/{stream.replace('.', '/')}"
