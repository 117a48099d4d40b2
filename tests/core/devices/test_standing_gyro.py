import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knotwork.core.devices.standing_gyro import StandingGyro

NOISE, SIGMA, PERIOD = 2.6e-4, 2e-4, 0.02


def rest(gyro: StandingGyro, bias: float, seconds: float, seed: int) -> None:
    white = np.random.default_rng(seed).standard_normal(round(seconds / PERIOD))
    for w in white:
        gyro.turn(bias * PERIOD + NOISE * math.sqrt(PERIOD) * w, PERIOD, True)


@settings(max_examples=40, deadline=None)
@given(bias=st.floats(-4e-4, 4e-4), seconds=st.sampled_from([3, 10, 60]), seed=st.integers(0, 10_000))
def test_the_bias_is_found_within_what_it_says_it_is_uncertain(bias, seconds, seed):
    gyro = StandingGyro(NOISE, SIGMA)
    rest(gyro, bias, seconds, seed)
    # the prior's pull is part of the error: a bias of two sigmas is shrunk
    assert abs(gyro.bias - bias) < 5.0 * gyro.sigma
    assert gyro.turn(0.01, 1.0, False) == pytest.approx(0.01 - gyro.bias)


def test_the_uncertainty_is_that_of_the_mean_of_a_constant():
    gyro = StandingGyro(NOISE, SIGMA, wander=0.0)
    rest(gyro, 1e-4, 10.0, 1)
    windows = math.floor((10.0 - 0.3) / 1.0)  # whole seconds after the body has settled
    expected = 1.0 / math.sqrt(1.0 / SIGMA**2 + windows / NOISE**2)
    assert gyro.sigma == pytest.approx(expected, rel=1e-6)


def test_a_bias_that_wanders_is_forgotten():
    gyro = StandingGyro(NOISE, SIGMA, wander=1e-5)
    rest(gyro, 1e-4, 30.0, 1)
    before = gyro.sigma
    for _ in range(1000):
        gyro.turn(0.001, 0.02, False)
    assert gyro.sigma == pytest.approx(math.hypot(before, 1e-5 * math.sqrt(20.0)))


def test_a_standing_robot_does_not_turn_and_one_that_is_turned_by_hand_does():
    gyro = StandingGyro(NOISE, SIGMA)
    rest(gyro, 3e-4, 5.0, 1)
    assert gyro.turn(3e-4 * PERIOD, PERIOD, True) == 0.0
    bias = gyro.bias
    turned = sum(gyro.turn(0.1 * PERIOD, PERIOD, True) for _ in range(100))
    assert turned == pytest.approx(0.2, rel=0.01)
    assert gyro.bias == bias
