import pytest
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core.link.clocks import ClockEstimate

MS = 1_000_000
delays = st.integers(0, 200 * MS)


@given(st.integers(-(10**13), 10**13), st.lists(st.tuples(delays, delays), min_size=1, max_size=40))
def test_the_offset_is_wrong_by_at_most_half_the_best_round_trip(offset, trips):
    clock, now = ClockEstimate(), 10**18
    for there, back in trips:
        clock.add(now, now + there + offset, now + there + back)
        now += 500 * MS
    best = min(there + back for there, back in trips[-16:])
    assert abs(clock.offset - offset) <= best // 2 + 1


@given(st.integers(-(10**13), 10**13), delays, delays, st.integers(0, 5000 * MS))
def test_an_age_is_never_too_young(offset, there, back, transit):
    """Wrong by half the round trip at most, and never below half of it."""
    clock = ClockEstimate()
    clock.add(0, there + offset, there + back)
    sent = 10**12
    age = clock.age(sent + offset, sent + transit)
    assert age >= (there + back) // 2
    assert age >= transit - (there + back) // 2 - 1
    assert age <= max(transit + (there + back) // 2 + 1, (there + back) // 2)


def test_another_clock():
    clock = ClockEstimate()
    assert not clock
    clock.add(0, 3000 * MS, 2 * MS)
    assert clock.offset == 2999 * MS
    assert clock.round_trip == 2 * MS
    clock.forget()
    assert not clock


def test_a_clock_that_steps_back_gives_no_sample():
    clock = ClockEstimate()
    clock.add(5, 5, 4)
    assert not clock
    with pytest.raises(ValueError, match="empty"):
        _ = clock.offset
