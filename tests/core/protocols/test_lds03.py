"""LDS-03: a packet worked out by hand from the maker's driver, and turns."""

import numpy as np
import pytest

from knotwork.core.protocols import lds03

EXAMPLE = bytes.fromhex("AA 55 C9 02 01 00 73 00 60 4F E0 A1 0F 41 71 17")


def test_example() -> None:
    packet = lds03.Parser().feed(EXAMPLE)[0]
    assert packet.starts
    assert packet.rate == pytest.approx(10.0)
    assert packet.distances == (1000, 1500)
    assert packet.intensities == (120, 80)
    assert (packet.first, packet.last) == (0.0, pytest.approx(0x73 // 2 / 64))
    assert (packet.end, packet.size) == (16, 16)
    again = bytearray(lds03.encode(True, 10.0, packet.first, packet.last, [1000, 1500], [120, 80]))
    # We send no sample as taken at high exposure; that bit is in the example's second sample.
    again[13] |= 1
    again[8] ^= 1
    assert bytes(again) == EXAMPLE


def packet(k: int) -> lds03.Packet:
    wire = lds03.encode(k == 0, 10.0, 36.0 * k, 36.0 * k + 35.1, [k * 40 + i for i in range(40)], [k] * 40)
    return lds03.Parser().feed(wire)[0]


def test_turns() -> None:
    turns = lds03.Revolutions()
    over = [t for n in range(31) for t in turns.add(packet(n % 10), n * 10_000_000)]
    assert len(over) == 3
    for turn in over:
        assert turn.whole
        assert turn.rate == pytest.approx(10.0)
        assert turn.distances.tolist() == list(range(400))
        np.testing.assert_allclose(np.degrees(turn.angles), 0.9 * np.arange(400), atol=1e-2)
        assert len(turn.stamps) == 10
        assert turn.packets[[0, 399]].tolist() == [0, 9]


def test_a_lost_start_and_a_silence_end_a_turn_too() -> None:
    turns = lds03.Revolutions()
    order = [5, 6, 1, 2]
    over = [t for n, k in enumerate(order) for t in turns.add(packet(k), n * 10_000_000)]
    over += turns.add(packet(3), 200_000_000)
    assert [(t.whole, len(t.angles)) for t in over] == [(False, 80), (False, 80)]


def test_wrong_arguments() -> None:
    with pytest.raises(ValueError, match="samples"):
        lds03.encode(True, 10.0, 0.0, 1.0, [], [])
