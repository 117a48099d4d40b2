"""LDS-01: a packet captured from a device, and turns put together from what arrives."""

import numpy as np
import pytest

from knotwork.core.protocols import lds01

CAPTURED = bytes.fromhex(
    "FA A0 C3 0B B0 22 8B 00 00 00 2C 30 89 00 00 00 42 27 8A 00 00 00 3C 21 8C 00 00 00 C6 0E 98 00 00 00"
    "3F 16 A4 00 00 00 14 14"
)


def test_captured_packet() -> None:
    packet = lds01.Parser().feed(CAPTURED)[0]
    assert (packet.sector, packet.rpm) == (0, pytest.approx(301.1))
    assert packet.distances == (139, 137, 138, 140, 152, 164)
    assert packet.intensities == (0x22B0, 0x302C, 0x2742, 0x213C, 0x0EC6, 0x163F)
    assert packet.end == 42
    assert lds01.encode(0, 301.1, list(packet.distances), list(packet.intensities)) == CAPTURED


def test_sync_after_a_doubled_header_byte() -> None:
    parser = lds01.Parser()
    assert len(parser.feed(b"\xfa" + CAPTURED)) == 1
    assert (parser.rejected, parser.skipped) == (1, 1)


def test_both_check_bytes_and_the_index_count() -> None:
    parser = lds01.Parser()
    for at, value in ((40, 0x15), (41, 0x15), (1, 0xDC)):
        bad = bytearray(CAPTURED)
        bad[at] = value
        if at == 1:
            bad[40] = bad[41] = lds01.checksum(bad[:40])
        assert parser.feed(bytes(bad)) == []
        parser.reset()
    assert parser.skipped == 3 * 42


def packet(sector: int, value: int = 0, turn: int = 0) -> lds01.Packet:
    """A packet of a stream that has lost nothing since sector 0 of turn 0."""
    end = lds01.PACKET * (lds01.SECTORS * turn + sector + 1)
    return lds01.Packet(sector, 300.0, (value + sector,) * 6, (7,) * 6, end)


def test_a_turn_with_missing_packets() -> None:
    turns = lds01.Revolutions()
    kept = [k for k in range(60) if k not in (0, 17, 59)]
    for k in kept:
        assert turns.add(packet(k, 100), k * 3_333_333) == []
    over = turns.add(packet(0, turn=1), 200_000_000)
    assert len(over) == 1
    turn = over[0]
    assert turn.missing == 3
    assert np.flatnonzero(~turn.sectors).tolist() == [0, 17, 59]
    assert turn.distances.shape == (360,)
    assert turn.distances[6 * 18 + 2] == 118
    assert turn.distances[6 * 17 : 6 * 18].tolist() == [0] * 6
    assert turn.stamps[18] == 18 * 3_333_333
    assert turn.rpm == pytest.approx(300.0)


def test_a_turn_is_given_at_its_last_packet_and_only_once() -> None:
    turns = lds01.Revolutions()
    given = [(k, turns.add(packet(k % 60, turn=k // 60), k * 3_333_333)) for k in range(180)]
    assert [k for k, over in given if over] == [59, 119, 179]
    assert all(over[0].missing == 0 for _, over in given if over)


def test_turns_across_a_silence_are_not_mixed() -> None:
    turns = lds01.Revolutions()
    for k in range(10):
        turns.add(packet(k), k * 3_333_333)
    # The sectors go on rising, but a whole turn later.
    (turn,) = turns.add(packet(12), 12 * 3_333_333 + 200_000_000)
    assert turn.missing == 50
    # A last packet alone closes the turn before it and its own.
    assert [t.missing for t in turns.add(packet(59), 2_000_000_000)] == [59, 59]


def test_a_damaged_sector_does_not_break_a_turn() -> None:
    turns = lds01.Revolutions()
    over = []
    for k in range(120):
        p = packet(k % 60, turn=k // 60)
        if k in (20, 70):  # ahead and behind: bit 5 of the index and of another byte flipped, the sum is right
            p = p._replace(sector=p.sector ^ 32)
        over += turns.add(p, k * 3_333_333)
    assert [turn.missing for turn in over] == [1, 1]
    assert [np.flatnonzero(~turn.sectors).tolist() for turn in over] == [[20], [10]]
    assert turns.misplaced == 2


def test_a_hole_in_the_stream_costs_no_packet_after_it() -> None:
    turns = lds01.Revolutions()
    over = []
    for k in range(120):
        if not 30 <= k < 75:  # lost with the bytes: the host was away, and its buffer full
            p = packet(k % 60, turn=k // 60)
            over += turns.add(p._replace(end=p.end - (45 * lds01.PACKET if k >= 75 else 0)), k * 3_333_333)
    assert [turn.missing for turn in over] == [30, 15]
    assert turns.misplaced == 0


@pytest.mark.parametrize("seed", range(3))
def test_dirty_stream_gives_one_scan_a_turn(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parser, turns = lds01.Parser(), lds01.Revolutions()
    over = []
    for k in range(60 * 300):
        data = np.frombuffer(lds01.encode(k % 60, 300.0, [500 + k % 60] * 6, [9] * 6), np.uint8)
        data = data[rng.random(len(data)) >= 0.01]
        data = data ^ np.packbits(rng.random((len(data), 8)) < 0.001, axis=1)[:, 0]
        for p in parser.feed(data.tobytes()):
            over += turns.add(p, k * 3_333_333)
    assert 298 <= len(over) <= 300
    for turn in over:  # each packet is where its stamp says, so that none tells a wrong beginning
        there = np.flatnonzero(turn.sectors)
        begun = turn.stamps[there] - there * 3_333_333
        assert begun.max() - begun.min() < 10


def test_wrong_arguments() -> None:
    with pytest.raises(ValueError, match="sector"):
        lds01.encode(60, 300.0, [0] * 6, [0] * 6)
    with pytest.raises(ValueError, match="readings"):
        lds01.encode(0, 300.0, [0] * 5, [0] * 6)
