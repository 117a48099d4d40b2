import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core.devices.device_clock import DeviceClock

MS = 1_000_000
BOOT = 1_700_000_000_000_000_000  # of the device, by the host's clock [ns]


@given(late=st.lists(st.integers(0, 300 * MS), min_size=1, max_size=40), start=st.integers(0, 2**31))
def test_stamps_are_never_too_early_and_exact_after_an_answer_that_came_at_once(late, start):
    clock = DeviceClock()
    known = False
    for k, delay in enumerate(late):
        taken = BOOT + (start + 20 * k) * MS
        stamp = clock.hear(start + 20 * k, taken + delay)
        known |= delay == 0
        assert stamp - taken == min(late[: k + 1])
        assert not known or stamp == taken


def test_a_crystal_that_runs_fast_is_followed():
    clock = DeviceClock()
    random = np.random.default_rng(4)
    errors = []
    for k in range(30_000):  # ten minutes, readings 0 to 20 ms old
        taken = round(20 * k * MS * (1 - 1e-4))
        stamp = clock.hear(20 * k, BOOT + taken + int(random.integers(0, 20 * MS)))
        errors.append(stamp - BOOT - taken)
    late = np.array(errors[50:]) / MS
    # the device gains 0.1 ms a second, and what was learned is at most two windows old
    assert late.max() < 1.5
    assert late.min() > -1.5


def test_a_device_that_has_restarted_is_met_anew():
    clock = DeviceClock()
    assert clock.hear(5_000, BOOT) == BOOT
    assert clock.hear(100, BOOT + 3_000 * MS) == BOOT + 3_000 * MS
    assert clock.hear(120, BOOT + 3_020 * MS) == BOOT + 3_020 * MS
