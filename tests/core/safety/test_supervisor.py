import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core.safety.config import SafetyConfig
from knotwork.core.safety.supervisor import Supervisor

MS = 1_000_000
FASTEST, SEPARATION = 0.2097, 0.16


class Bench:
    """A supervisor stepped every 20 ms."""

    def __init__(self, **config) -> None:
        self.lines: list[str] = []
        self.base = Supervisor(SafetyConfig(**config), SEPARATION, FASTEST, lambda level, text: self.lines.append(text))
        self.base.problem = ""
        self.now = 1_000 * MS
        self.step()

    def step(self, seconds: float = 0.02, command: tuple[float, float] | None = None) -> tuple[float, float]:
        """Step through `seconds`; with a command, give it anew before each step."""
        speeds = (self.base.ramp.left, self.base.ramp.right)
        for _ in range(max(1, round(seconds / 0.02))):
            self.now += 20 * MS
            if command is not None:
                self.base.command(*command, self.now, self.now)
            speeds = self.base.step(self.now)
        return speeds


def test_a_command_is_followed_as_long_as_it_is_repeated():
    bench = Bench()
    assert bench.step(1.0, (0.1, 0.5)) == pytest.approx((0.06, 0.14))
    assert bench.base.state == "ready"


def test_the_command_time_out_counts_from_the_stamp_and_stops_by_a_ramp():
    bench = Bench(command_timeout=0.25)
    bench.step(1.0, (0.2, 0.0))
    stamp = bench.now
    began = None
    while not bench.base.standing:
        speeds = bench.step()
        if speeds[0] < 0.2 and began is None:
            began = bench.now
    assert (began - stamp) / MS == pytest.approx(260, abs=10)  # the first step after 250 ms
    assert (bench.now - stamp) / MS <= 250 + 20 + 0.2 / 1.5 * 1000 + 20
    assert bench.base.counters == {"command_timeouts": 1}
    assert bench.base.state == "ready"  # not a fault: the next command is followed
    assert bench.step(0.02, (0.2, 0.0))[0] > 0


def test_a_command_that_was_emitted_long_ago_is_refused_on_arrival():
    bench = Bench()
    assert not bench.base.command(0.1, 0.0, bench.now - 251 * MS, bench.now)
    assert bench.step() == (0.0, 0.0)
    assert bench.base.counters == {"stale_commands": 1}


def test_a_stamp_from_the_future_does_not_live_longer():
    bench = Bench()
    bench.base.command(0.1, 0.0, bench.now + 10_000 * MS, bench.now)
    bench.step(0.6)
    assert bench.base.standing


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_no_number_is_refused_and_does_not_replace_the_last_one(bad):
    bench = Bench()
    bench.step(0.5, (0.1, 0.0))
    assert not bench.base.command(bad, 0.0, bench.now, bench.now)
    assert not bench.base.command(0.0, bad, bench.now, bench.now)
    assert bench.step() == pytest.approx((0.1, 0.1))
    assert bench.base.counters["invalid_commands"] == 2


def test_after_a_fault_the_base_stands_until_rearmed_though_the_cause_has_gone():
    bench = Bench()
    bench.step(1.0, (0.2, 0.0))
    bench.base.problem = "the lidar is silent"
    bench.step(0.2, (0.2, 0.0))
    assert bench.base.standing
    assert (bench.base.state, bench.base.reason) == ("fault", "the lidar is silent")
    bench.base.problem = ""
    assert bench.step(10.0, (0.2, 0.0)) == (0.0, 0.0)
    bench.base.request("rearm")
    bench.step()
    assert bench.base.state == "ready"
    assert bench.step() == (0.0, 0.0)  # what was commanded before does not count
    assert bench.step(0.5, (0.2, 0.0)) == pytest.approx((0.2, 0.2))


def test_rearming_is_refused_while_the_cause_lasts():
    bench = Bench()
    bench.base.problem = "the lidar is silent"
    bench.step()
    bench.base.request("rearm")
    bench.step()
    bench.base.problem = ""
    bench.step(1.0, (0.2, 0.0))
    assert bench.base.standing
    assert bench.base.state == "fault"
    assert any("cannot re-arm" in line for line in bench.lines)


def test_automatic_rearming_waits_a_second_without_any_trouble():
    bench = Bench(rearm="auto")
    bench.base.problem = "gone"
    bench.step()
    bench.base.problem = ""
    bench.step(0.9, (0.2, 0.0))
    assert bench.base.standing
    bench.base.problem = "gone again"
    bench.step()
    bench.base.problem = ""
    bench.step(0.9, (0.2, 0.0))
    assert bench.base.standing
    bench.step(0.3, (0.2, 0.0))
    assert not bench.base.standing


def test_an_emergency_stop_is_never_rearmed_by_itself_nor_by_a_later_fault():
    bench = Bench(rearm="auto")
    bench.step(1.0, (0.2, 0.0))
    bench.base.request("stop")
    bench.step(0.2, (0.2, 0.0))
    assert bench.base.standing
    bench.base.problem = "the lidar is silent"
    bench.step()
    bench.base.problem = ""
    bench.step(5.0, (0.2, 0.0))
    assert bench.base.standing
    assert bench.base.state == "emergency"
    bench.base.request("rearm")
    assert bench.step(0.5, (0.2, 0.0)) == pytest.approx((0.2, 0.2))


def test_before_the_first_data_the_base_waits_without_a_fault():
    bench = Bench()
    fresh = Supervisor(SafetyConfig(), SEPARATION, FASTEST, lambda level, text: None)
    fresh.problem = "no data from the lidar yet"
    fresh.command(0.1, 0.0, bench.now, bench.now)
    assert fresh.step(bench.now) == (0.0, 0.0)
    assert fresh.state == "waiting"
    fresh.problem = ""
    fresh.command(0.1, 0.0, bench.now, bench.now)
    fresh.step(bench.now + 20 * MS)
    assert fresh.state == "ready"
    assert not fresh.standing


def test_a_base_that_was_out_of_reach_stands_when_it_comes_back():
    bench = Bench()
    bench.step(1.0, (0.2, 0.0))
    bench.base.lost("unplugged")
    assert bench.base.standing
    bench.base.problem = ""
    assert bench.step(1.0, (0.2, 0.0)) == (0.0, 0.0)
    assert bench.base.state == "fault"


def test_the_end_of_the_run_is_a_ramped_stop_that_no_command_undoes():
    bench = Bench()
    bench.step(1.0, (0.2, 0.0))
    bench.base.end()
    assert 0 < bench.step(0.02, (0.2, 0.0))[0] < 0.2
    bench.step(0.2, (0.2, 0.0))
    assert bench.base.standing


events = st.lists(
    st.one_of(
        st.tuples(st.just("command"), st.floats(allow_nan=True), st.floats(allow_nan=True), st.integers(-400, 400)),
        st.tuples(st.just("problem"), st.sampled_from(["", "the lidar is silent"])),
        st.tuples(st.just("request"), st.sampled_from(["stop", "rearm"])),
        st.tuples(st.just("lost")),
        st.tuples(st.just("pause"), st.integers(1, 2000)),
    ),
    max_size=60,
)


@given(events=events, rearm=st.sampled_from(["manual", "auto"]))
def test_whatever_happens_speeds_stay_within_limits_and_a_base_not_ready_slows_down(events, rearm):
    bench = Bench(rearm=rearm)
    base = bench.base
    for what, *arguments in events:
        if what == "command":
            v, w, age = arguments
            base.command(v, w, bench.now - age * MS, bench.now)
        elif what == "problem":
            base.problem = arguments[0]
        elif what == "request":
            base.request(arguments[0])
        elif what == "lost":
            base.lost("unplugged")
        else:
            bench.now += arguments[0] * MS
        before = (base.ramp.left, base.ramp.right)
        after = bench.step()
        for a, b in zip(before, after, strict=True):
            assert math.isfinite(b)
            assert abs(b) <= FASTEST * (1 + 1e-12)
            assert abs(b - a) <= 1.5 * 0.05 * (1 + 1e-9)
            if base.state != "ready":
                assert b == 0.0 or abs(b) < abs(a)
