"""Wheels that are told to turn and do not are told from a host that has not looked."""

from knotwork.core.safety.frozen import FrozenWheels

MS = 1_000_000


def test_wheels_that_do_not_turn_for_a_second_are_frozen():
    frozen = FrozenWheels()
    looks = [frozen.look(True, 0, read * MS) for read in range(0, 1200, 20)]
    assert looks.index(True) * 20 == 1020
    assert not frozen.look(False, 0, 1300 * MS)
    assert not frozen.look(True, 0, 1320 * MS)


def test_wheels_that_turn_are_not_frozen():
    frozen = FrozenWheels()
    assert not any(frozen.look(True, read * MS, read * MS) for read in range(0, 5000, 20))


def test_a_host_that_has_not_read_them_for_long_says_nothing_of_the_wheels():
    frozen = FrozenWheels()
    assert not frozen.look(True, 0, 100 * MS)
    assert not frozen.look(True, 100 * MS, 120 * MS)
    for _ in range(100):  # each time the loop comes round, and nothing new has been read
        assert not frozen.look(True, 100 * MS, 120 * MS)
    assert not frozen.look(True, 2000 * MS, 2000 * MS)
