"""LDS-02: published figures of checksum and geometry, turns, and beams of fixed number."""

import numpy as np
import pytest

from knotwork.core.protocols import lds02


def test_published_crc() -> None:
    assert lds02.crc8(b"123456789") == 0xC3


def test_published_header() -> None:
    wire = lds02.encode(2152, 32427, 33470, [1000] * 12, [200] * 12, 6714)
    assert wire[:6] == bytes.fromhex("54 2C 68 08 AB 7E")
    assert wire[42:46] == bytes.fromhex("BE 82 3A 1A")
    packet = lds02.Parser().feed(wire)[0]
    assert packet == (2152, 32427, 33470, (1000,) * 12, (200,) * 12, 6714, 47)


def test_second_kind_of_header_and_implausible_span() -> None:
    wire = bytearray(lds02.encode(2152, 0, 1033, [5] * 12, [1] * 12, 0))
    wire[1] = 0xEC
    wire[-1] = lds02.crc8(wire[:-1])
    assert len(lds02.Parser().feed(bytes(wire))) == 1
    parser = lds02.Parser()
    assert parser.feed(lds02.encode(2152, 0, 1900, [5] * 12, [1] * 12, 0)) == []
    assert parser.rejected == 1


@pytest.mark.parametrize(("distance", "angle", "reach"), [(1000, 5.63, 1.011), (300, 2.92, 0.30623)])
def test_published_geometry(distance: int, angle: float, reach: float) -> None:
    angles, ranges = lds02.corrected(np.radians([90.0]), np.array([distance], np.uint16))
    assert np.degrees(angles[0]) == pytest.approx(270.0 + angle, abs=0.006)
    assert ranges[0] == pytest.approx(reach, abs=6e-4)


def test_invalid_readings() -> None:
    angles, ranges = lds02.corrected(np.zeros(2), np.array([0, 200], np.uint16))
    assert np.isnan(ranges[0])
    assert ranges[1] > 0.2
    assert ((angles >= 0.0) & (angles < 2.0 * np.pi)).all()


STEP = 93.913  # 0.01 degrees, at 6 turns a second


def stream(count: int, first: float = 3000.0) -> list[lds02.Packet]:
    """Packets whose distances number the points."""
    out = []
    for k in range(count):
        start = first + k * 12 * STEP
        end = round(start + 11 * STEP) % 36000
        numbers = tuple(range(12 * k, 12 * k + 12))
        out.append(lds02.Packet(2160, round(start) % 36000, end, numbers, (9,) * 12, 0, 0))
    return out


def test_turns_split_at_zero_and_lose_no_point() -> None:
    turns = lds02.Revolutions()
    over = [t for k, p in enumerate(stream(100)) for t in turns.add(p, k * 5_217_391)]
    assert len(over) == 3
    points = np.concatenate([t.distances for t in over])
    assert points.tolist() == list(range(len(points)))
    for turn in over:
        assert (np.diff(turn.angles) > 0.0).all()
        assert turn.missing == 0
        assert turn.angles[-1] < 2.0 * np.pi
        assert turn.packets.max() == len(turn.stamps) - 1
    assert [len(t.distances) for t in over[1:]] in ([383, 383], [383, 384], [384, 383])


def test_lost_packets_are_counted() -> None:
    turns = lds02.Revolutions()
    packets = [p for k, p in enumerate(stream(70)) if k not in (5, 6, 20)]
    over = [t for k, p in enumerate(packets) for t in turns.add(p, k * 5_217_391)]
    assert over[0].missing == 3


def test_a_silence_ends_a_turn() -> None:
    turns = lds02.Revolutions()
    a, b = stream(2)
    turns.add(a, 0)
    assert len(turns.add(b, 160_000_000)) == 1


def test_beams() -> None:
    angles = np.radians([0.1, 359.8, 90.4, 180.0, 181.0, 270.0])
    ranges = np.array([2.0, 1.0, 3.0, np.nan, 5.0, 6.0])
    values = np.arange(6, dtype=np.uint8)
    beams, carried = lds02.binned(angles, ranges, values, 360)
    assert beams[[0, 90, 181, 270]].tolist() == [1.0, 3.0, 5.0, 6.0]  # the nearer of two
    assert carried[[0, 90, 181, 270]].tolist() == [1.0, 2.0, 4.0, 5.0]
    assert np.isnan(beams).sum() == 356


def test_wrong_arguments() -> None:
    with pytest.raises(ValueError, match="12"):
        lds02.encode(2160, 0, 1033, [0] * 11, [0] * 12, 0)
