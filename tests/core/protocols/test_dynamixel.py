"""Frames against ROBOTIS's documents and SDK, and against damage."""

import dynamixel_sdk
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core.protocols import dynamixel as dxl

VECTORS = {
    "ping 1": (dxl.ping(1), "FF FF FD 00 01 03 00 01 19 4E"),
    "ping reply": (dxl.status(1, 0, b"\x06\x04\x26"), "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D"),
    "sync read": (dxl.sync_read((1, 2), 132, 4), "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA"),
    "sync write": (
        dxl.sync_write(116, {1: b"\x96\0\0\0", 2: b"\xaa\0\0\0"}),
        "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
    ),
    "sync write of negative values": (
        dxl.sync_write(104, {1: b"\x64\0\0\0", 2: b"\x9c\xff\xff\xff"}),
        "FF FF FD 00 FE 11 00 83 68 00 04 00 01 64 00 00 00 02 9C FF FF FF 5A 21",
    ),
    "stuffed write": (dxl.write(1, 104, b"\xff\xff\xfd\0"), "FF FF FD 00 01 0A 00 03 68 00 FF FF FD FD 00 E2 7A"),
    "fast sync read": (dxl.fast_sync_read((1, 2), 132, 4), "FF FF FD 00 FE 09 00 8A 84 00 04 00 01 02 4D 72"),
    "ping 200": (dxl.ping(200), "FF FF FD 00 C8 03 00 01 3B FA"),
    "OpenCR's reply": (dxl.status(200, 0, b"\0\x50\x05"), "FF FF FD 00 C8 07 00 55 00 00 50 05 4C B7"),
    "heartbeat": (dxl.write(200, 19, b"\1"), "FF FF FD 00 C8 06 00 03 13 00 01 37 A7"),
    "command": (
        dxl.write(200, 150, b"\x0a" + bytes(19) + b"\x32\0\0\0"),
        "FF FF FD 00 C8 1D 00 03 96 00 0A 00 00 00" + " 00" * 16 + " 32 00 00 00 4D 37",
    ),
    "torque": (dxl.write(200, 149, b"\1"), "FF FF FD 00 C8 06 00 03 95 00 01 4C 2D"),
    "read": (dxl.read(200, 10, 172), "FF FF FD 00 C8 07 00 02 0A 00 AC 00 B6 2F"),
    "acknowledgement": (dxl.status(200), "FF FF FD 00 C8 04 00 55 00 19 2D"),
}


@pytest.mark.parametrize("name", VECTORS)
def test_published_frames(name: str) -> None:
    made, published = VECTORS[name]
    assert made.hex(" ").upper() == published
    parser = dxl.Parser()
    packet = parser.feed(made)[0]
    assert (parser.packets, parser.rejected, parser.skipped) == (1, 0, 0)
    again = (
        dxl.status(packet.id, packet.error, packet.data)
        if packet.is_status
        else dxl.encode(packet.id, packet.instruction, packet.data)
    )
    assert again == made


nasty = st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0xFE]), max_size=40).map(bytes) | st.binary(max_size=60)


@given(nasty)
def test_stuffing_round_trip_and_no_header_inside(data: bytes) -> None:
    stuffed = dxl.stuff(data)
    assert dxl.unstuff(stuffed) == data
    assert dxl.HEADER not in stuffed
    assert dxl.Parser().feed(dxl.write(1, 104, data))[0].data[2:] == data


@given(
    st.integers(1, 60), st.lists(st.tuples(st.integers(0, 252), st.integers(0, 255)), min_size=1, max_size=5), st.data()
)
def test_fast_sync_reply_comes_apart(length: int, heads: list[tuple[int, int]], data: st.DataObject) -> None:
    parts = [
        dxl.Packet(i, dxl.Instruction.STATUS, e, data.draw(st.binary(min_size=length, max_size=length)))
        for i, e in heads
    ]
    packet = dxl.Parser().feed(dxl.fast_status(parts))[0]
    assert [p[:4] for p in dxl.split_fast(packet, length)] == [p[:4] for p in parts]
    assert dxl.split_fast(packet, length + 1000) == []


class Wire:
    """A port of ROBOTIS's SDK that ends in a list."""

    def __init__(self, answer: bytes = b"") -> None:
        self.sent = b""
        self.answer = answer
        self.is_using = False

    def clearPort(self) -> None:
        pass

    def writePort(self, data: list[int]) -> int:
        self.sent += bytes(data)
        return len(data)

    def readPort(self, length: int) -> bytes:
        data, self.answer = self.answer[:length], self.answer[length:]
        return data

    def setPacketTimeout(self, length: int) -> None:
        pass

    def isPacketTimeout(self) -> bool:
        return not self.answer


SDK = dynamixel_sdk.PacketHandler(2.0)
ids, addresses = st.integers(0, 252), st.integers(0, 500)
# The SDK never stuffs what it sends.
plain = st.binary(min_size=1, max_size=60).filter(lambda data: b"\xff\xff\xfd" not in dxl.write(1, 104, data)[7:-2])


@given(ids, addresses, st.integers(1, 200), plain)
def test_frames_are_those_of_the_sdk(device: int, address: int, length: int, data: bytes) -> None:
    wire = Wire()
    SDK.writeTxOnly(wire, device, address, len(data), list(data))
    assert wire.sent == dxl.write(device, address, data)
    wire = Wire()
    SDK.readTx(wire, device, address, length)
    assert wire.sent == dxl.read(device, address, length)
    wire = Wire()
    SDK.syncWriteTxOnly(wire, address, len(data), [device, *data], 1 + len(data))
    assert wire.sent == dxl.sync_write(address, {device: data})
    for fast, made in ((False, dxl.sync_read), (True, dxl.fast_sync_read)):
        wire = Wire()
        SDK.syncReadTx(wire, address, length, [1, 2], 2, fast)
        assert wire.sent == made((1, 2), address, length)
    assert SDK.updateCRC(0, list(data), len(data)) == dxl.crc16(data)


@given(ids, plain)
def test_the_sdk_takes_our_answers(device: int, data: bytes) -> None:
    wire = Wire(dxl.status(device, 0x80, data))
    values, result, error = SDK.readTxRx(wire, device, 0, len(data))
    assert (bytes(values), result, error) == (data, dynamixel_sdk.COMM_SUCCESS, 0x80)


def test_an_unstuffed_frame_of_the_sdk_is_understood() -> None:
    wire = Wire()
    SDK.writeTxOnly(wire, 1, 104, 4, [0xFF, 0xFF, 0xFD, 0x00])
    assert wire.sent != dxl.write(1, 104, b"\xff\xff\xfd\x00")  # its fault
    assert dxl.Parser().feed(wire.sent)[0].data[2:] == b"\xff\xff\xfd\x00"


def test_a_damaged_length_costs_little() -> None:
    parser = dxl.Parser(longest=64)
    bad = bytearray(dxl.status(1, 0, b"abc"))
    bad[6] = 0xFF
    assert [p.data for p in parser.feed(bytes(bad) + dxl.status(1, 0, b"next"))] == [b"next"]
    assert parser.rejected == 1


def test_error_bytes() -> None:
    packet = dxl.Parser().feed(dxl.status(3, dxl.ALERT | dxl.Error.DATA_LIMIT))[0]
    assert packet.is_status
    assert packet.alert
    assert packet.failure == dxl.Error.DATA_LIMIT


def test_wrong_arguments() -> None:
    with pytest.raises(ValueError, match="lengths"):
        dxl.sync_write(104, {1: b"ab", 2: b"a"})
    with pytest.raises(ValueError, match="fit"):
        dxl.write(1, 0, bytes(0xF001))
