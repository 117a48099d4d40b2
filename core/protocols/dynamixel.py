"""Dynamixel protocol 2.0: frames with CRC and byte stuffing, both ways.

`FF FF FD 00 | id | length (2) | instruction | parameters | CRC (2)`; a status packet has the instruction
0x55 and starts its parameters with an error byte.
"""

from collections.abc import Iterable, Mapping
from enum import IntEnum
from typing import NamedTuple

from knotwork.core.protocols.framing import StreamParser

BROADCAST = 0xFE
ID_MAX = 252
ALERT = 0x80  # of an error byte: read the hardware error register; the command itself may have succeeded

HEADER = b"\xff\xff\xfd\x00"
_STUFF, _STUFFED = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"


class Instruction(IntEnum):
    """What a packet asks for; STATUS is the answer."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class Error(IntEnum):
    """Low seven bits of an error byte."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


class Packet(NamedTuple):
    """A packet without its framing.

    Attributes
    ----------
    id
        0...252 of a device, 254 for all.
    instruction
        One of `Instruction`, or another byte.
    error
        Error byte of a status packet, alert bit included; 0 for instructions.
    data
        Parameters, unstuffed, without the error byte.
    end
        Position of the packet's end in the stream: bytes fed to the parser up to its last one.
    """

    id: int
    instruction: int
    error: int
    data: bytes
    end: int = 0

    @property
    def is_status(self) -> bool:
        """Whether this is an answer; adapters may echo what the host sent."""
        return self.instruction == Instruction.STATUS

    @property
    def alert(self) -> bool:
        """Whether the device reports a hardware error."""
        return bool(self.error & ALERT)

    @property
    def failure(self) -> int:
        """Why the command was refused: one of `Error`, 0 if it was not."""
        return self.error & 0x7F


class Parser(StreamParser[Packet]):
    """Finds packets of protocol 2.0 in a stream of bytes, instructions and answers alike.

    Frames whose sender forgot the byte stuffing, as ROBOTIS's Python SDK does, are taken too.

    Parameters
    ----------
    longest
        Packets that claim to be longer [bytes] are refused, so that a damaged length costs little.
    """

    header = HEADER

    def __init__(self, longest: int = 1024) -> None:
        super().__init__()
        self._longest = longest

    def _length(self, buffer: bytearray, start: int) -> int:
        if start + 7 > len(buffer):
            return 0
        length = 7 + (buffer[start + 5] | buffer[start + 6] << 8)
        if not 10 <= length <= self._longest:
            return -1
        # Do not wait for the end that a damaged length promises once a whole packet has followed.
        return length if start + length <= len(buffer) or not self._overtaken(buffer, start + 1) else -1

    def _overtaken(self, buffer: bytearray, start: int) -> bool:
        size = len(buffer)
        while 0 <= (start := buffer.find(HEADER, start)) <= size - 10:
            end = start + 7 + (buffer[start + 5] | buffer[start + 6] << 8)
            if start + 10 <= end <= size and _intact(buffer, start, end):
                return True
            start += 1
        return False

    def _decode(self, buffer: bytearray, start: int, end: int, position: int) -> Packet | None:
        if not _intact(buffer, start, end):
            return None
        device, instruction = buffer[start + 4], buffer[start + 7]
        if instruction != Instruction.STATUS:
            return Packet(device, instruction, 0, unstuff(bytes(buffer[start + 8 : end - 2])), position)
        if end - start < 11:
            return None
        data = bytes(buffer[start + 8 : end - 2])
        # The parts of a fast sync reply come from several motors; none of them stuffs.
        data = data if device == BROADCAST else unstuff(data)
        return Packet(device, instruction, data[0], data[1:], position)


def _intact(buffer: bytearray, start: int, end: int) -> bool:
    return crc16(buffer[start : end - 2]) == buffer[end - 2] | buffer[end - 1] << 8


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (0x8005 if crc & 0x8000 else 0)
        table.append(crc & 0xFFFF)
    return tuple(table)


_CRC = _crc_table()


def crc16(data: bytes | bytearray, crc: int = 0) -> int:
    """Return the CRC-16 with polynomial 0x8005, not reflected, continued from `crc`."""
    table = _CRC
    for byte in data:
        crc = (crc << 8 & 0xFF00) ^ table[crc >> 8 ^ byte]
    return crc


def stuff(data: bytes) -> bytes:
    """Insert FD after every FF FF FD, so that no header appears in a packet's body."""
    return data.replace(_STUFF, _STUFFED)


def unstuff(data: bytes) -> bytes:
    """Invert `stuff`."""
    return data.replace(_STUFFED, _STUFF)


def encode(device: int, instruction: int, parameters: bytes = b"") -> bytes:
    """Return an instruction packet.

    Raises
    ------
    ValueError
        An id that is no byte, or more parameters than a packet can carry.
    """
    if len(parameters) > 0xF000:
        raise ValueError(f"{len(parameters)} bytes do not fit into a packet")
    return _frame(device, stuff(bytes((instruction,)) + parameters))


def _frame(device: int, body: bytes) -> bytes:
    frame = HEADER + bytes((device,)) + (len(body) + 2).to_bytes(2, "little") + body
    return frame + crc16(frame).to_bytes(2, "little")


def ping(device: int) -> bytes:
    """Ask a device, or all (`BROADCAST`), for model number and firmware version."""
    return encode(device, Instruction.PING)


def reboot(device: int) -> bytes:
    """Restart a device: clears its hardware error, and the count of whole turns."""
    return encode(device, Instruction.REBOOT)


def read(device: int, address: int, length: int) -> bytes:
    """Ask for `length` bytes of the control table."""
    return encode(device, Instruction.READ, _words(address, length))


def write(device: int, address: int, data: bytes) -> bytes:
    """Write into the control table."""
    return encode(device, Instruction.WRITE, _words(address) + data)


def sync_read(devices: Iterable[int], address: int, length: int) -> bytes:
    """Ask several devices for the same registers; each answers with a status packet, in this order."""
    return encode(BROADCAST, Instruction.SYNC_READ, _words(address, length) + bytes(devices))


def fast_sync_read(devices: Iterable[int], address: int, length: int) -> bytes:
    """Ask several devices for the same registers; they answer with one packet, see `split_fast`."""
    return encode(BROADCAST, Instruction.FAST_SYNC_READ, _words(address, length) + bytes(devices))


def sync_write(address: int, values: Mapping[int, bytes]) -> bytes:
    """Write the same registers of several devices, `values` by id; nobody answers.

    Raises
    ------
    ValueError
        Values of different lengths, or none.
    """
    lengths = {len(value) for value in values.values()}
    if len(lengths) != 1:
        raise ValueError(f"expected values of one length, found lengths {sorted(lengths)}")
    parts = b"".join(bytes((device,)) + value for device, value in values.items())
    return encode(BROADCAST, Instruction.SYNC_WRITE, _words(address, lengths.pop()) + parts)


def status(device: int, error: int = 0, data: bytes = b"") -> bytes:
    """Return an answer, as a device sends it."""
    return _frame(device, stuff(bytes((Instruction.STATUS, error)) + data))


def fast_status(parts: list[Packet]) -> bytes:
    """Return the one answer of several devices to a fast sync read; none of its bytes is stuffed."""
    length = 1 + sum(4 + len(part.data) for part in parts)
    frame = HEADER + bytes((BROADCAST, *length.to_bytes(2, "little"), Instruction.STATUS))
    for part in parts:
        frame += bytes((part.error, part.id)) + part.data
        frame += crc16(frame).to_bytes(2, "little")
    return frame


def split_fast(packet: Packet, length: int) -> list[Packet]:
    """Take the answer to a fast sync read of `length` bytes apart; an empty list if it does not fit."""
    stride = length + 4
    body = bytes((packet.error,)) + packet.data
    if packet.id != BROADCAST or (len(body) + 2) % stride:
        return []
    return [
        Packet(body[at + 1], Instruction.STATUS, body[at], body[at + 2 : at + 2 + length], packet.end)
        for at in range(0, len(body), stride)
    ]


def _words(*values: int) -> bytes:
    return b"".join(value.to_bytes(2, "little") for value in values)
