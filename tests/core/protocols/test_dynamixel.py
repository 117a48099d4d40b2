"""Frames against ROBOTIS's documents and SDK, and against damage."""

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
