"""A run that a viewer pauses, steps and hurries."""

import pytest

from knotwork.core import clock
from knotwork.core.errors import InputError
from knotwork.core.runtime.pace import Pace

SECOND = 1_000_000_000


@pytest.fixture
def wall(monkeypatch):
    class Wall:
        now = 5 * SECOND

    monkeypatch.setattr(clock, "monotonic", lambda: Wall.now)
    return Wall


def test_free(wall):
    pace = Pace(None)
    assert pace.wait(0, None) == 0
    pace.begin(0)
    assert pace.wait(10**15, None, 0) == 0


def test_paused_nothing_is_due(wall):
    pace = Pace(None)
    pace.begin(0)
    pace.pause()
    assert pace.paused
    assert pace.wait(0, 0, 0) > 0
    pace.resume()
    assert pace.wait(0, 0, 0) == 0


def test_a_step_ends_with_its_message_type(wall):
    pace = Pace(2.0)
    pace.begin(0)
    pace.step("scan")
    assert pace.paused
    assert pace.wait(50 * SECOND, None, 0) == 0  # at once, whatever the rate
    pace.passed("odometry", SECOND)
    assert pace.wait(50 * SECOND, None, SECOND) == 0
    pace.passed("scan", 50 * SECOND)
    assert pace.wait(51 * SECOND, None, 50 * SECOND) > 0
    wall.now += 100 * SECOND
    pace.resume()
    assert pace.wait(50 * SECOND, None, 50 * SECOND) == 0
    # The pause is not made up for: a second of the log takes half of one from now on.
    wall.now += SECOND // 4
    assert pace.now(None) == 50 * SECOND + SECOND // 2


def test_another_rate_goes_on_from_here(wall):
    pace = Pace(1.0)
    pace.begin(0)
    wall.now += 10 * SECOND
    assert pace.now(None) == 10 * SECOND
    pace.rate = 4.0
    pace.wait(10 * SECOND, None, 10 * SECOND)
    wall.now += SECOND
    assert pace.now(None) == 14 * SECOND
    pace.rate = None
    assert pace.wait(10**15, None, 0) == 0


def test_a_rate_must_be_above_zero():
    pace = Pace(1.0)
    for rate in (0, -1, float("inf"), float("nan")):
        with pytest.raises(InputError):
            pace.rate = rate
    assert pace.rate == 1.0
