"""The simulated base: exact without errors, and with the statistics it claims."""

import numpy as np
import pytest
from scipy import stats

from knotwork.core.geometry import relative
from knotwork.core.world.base import SimulatedBase
from knotwork.core.world.kinematics import arc
from knotwork.core.world.odometry import DeadReckoning
from knotwork.core.world.parameters import BaseParameters
from knotwork.core.world.raycast import RayCaster
from knotwork.core.world.scene import World, box

STEP = 20_000_000
EXACT = BaseParameters().exact()


def drive(base, steps, reckoning=None):
    legs, readings, odometry = [], [], []
    for k in range(steps):
        leg, reading = base.step(k * STEP, (k + 1) * STEP)
        legs.append(leg)
        readings.append(reading)
        if reckoning is not None:
            odometry.append(reckoning.update((k + 1) * STEP, reading.left, reading.right, reading.yaw_rate, 0.02))
    return legs, readings, odometry


def within(sample, sigma, level=0.9999):
    """Mean zero and standard deviation `sigma` cannot be rejected."""
    n = len(sample)
    assert abs(np.mean(sample)) < stats.norm.ppf(0.5 + level / 2) * sigma / np.sqrt(n)
    low, high = stats.chi2.ppf([(1 - level) / 2, (1 + level) / 2], n)
    assert low < np.sum(np.square(sample)) / sigma**2 < high


@pytest.mark.parametrize("gyro", [True, False])
def test_without_errors_odometry_is_the_truth(gyro):
    base = SimulatedBase(EXACT, None, (3.0, -1.0, 2.0), seed=1)
    reckoning = DeadReckoning(EXACT, gyro=gyro, covariance=True)
    rng = np.random.default_rng(0)
    for _ in range(60):
        base.command(*rng.uniform((-0.2, -2), (0.2, 2)))
        drive(base, 10, reckoning)
    np.testing.assert_allclose(reckoning.pose, relative((3.0, -1.0, 2.0), base.pose), atol=1e-10)


def test_constant_command_is_an_exact_arc():
    fast = EXACT.model_copy(update={"acceleration": 1e6})
    base = SimulatedBase(fast, None, (0.0, 0.0, 0.0), seed=1)
    base.command(0.1, 0.7)
    drive(base, 250)
    np.testing.assert_allclose(base.pose, arc((0, 0, 0), 0.5, 3.5), atol=1e-12)


def test_the_wheels_ramp_and_saturate_with_the_curvature_kept():
    base = SimulatedBase(EXACT, None, (0.0, 0.0, 0.0), seed=1)
    v, w = base.command(0.22, 1.0)  # more than a Burger can do
    assert v + 0.08 * w == pytest.approx(0.2097)
    assert v * 1.0 == pytest.approx(0.22 * w)
    speeds = []
    for k in range(30):
        base.step(k * STEP, (k + 1) * STEP)
        speeds.append((base.left, base.right))
    assert np.diff(speeds, axis=0).max() == pytest.approx(1.0 * 0.02)
    np.testing.assert_allclose(speeds[-1], (v - 0.08 * w, v + 0.08 * w))
    base.command(0.0, 0.0)
    base.step(0, STEP)
    assert base.right == pytest.approx(v + 0.08 * w - 1.5 * 0.02)


def test_wheels_can_be_commanded_one_by_one():
    base = SimulatedBase(EXACT, None, (0.0, 0.0, 0.0), seed=1)
    assert base.command_wheels(-0.1, 0.3) == pytest.approx((-0.2097 / 3, 0.2097))
    drive(base, 30)
    assert (base.left, base.right) == pytest.approx((-0.2097 / 3, 0.2097))


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_command_must_be_finite(bad):
    base = SimulatedBase(EXACT, None, (0.0, 0.0, 0.0), seed=1)
    with pytest.raises(ValueError, match="finite"):
        base.command(0.1, bad)


def test_encoders_count_whole_ticks_of_the_wheels():
    base = SimulatedBase(EXACT.model_copy(update={"ticks": 4096}), None, (0.0, 0.0, 0.0), seed=1)
    base.command(0.1, 0.4)
    _, readings, _ = drive(base, 200)
    exact = SimulatedBase(EXACT, None, (0.0, 0.0, 0.0), seed=1)
    exact.command(0.1, 0.4)
    _, smooth, _ = drive(exact, 200)
    tick = 2 * np.pi / 4096
    ticks = np.array([(r.left, r.right) for r in readings]) / tick
    np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-6)
    behind = np.array([(s.left, s.right) for s in smooth]) / tick - ticks
    assert behind.min() > -1e-6
    assert behind.max() < 1.0


def test_white_slip_has_its_sigma():
    slipping = EXACT.model_copy(update={"slip": 0.002})
    base = SimulatedBase(slipping, None, (0.0, 0.0, 0.0), seed=5)
    base.command(0.15, 0.5)
    drive(base, 20)  # up to speed
    legs, _, _ = drive(base, 3000)
    rims = np.array([(leg.v - 0.08 * leg.w, leg.v + 0.08 * leg.w) for leg in legs]) * 0.02
    for wheel, speed in ((0, 0.15 - 0.08 * 0.5), (1, 0.15 + 0.08 * 0.5)):
        within(rims[:, wheel] - speed * 0.02, 0.002 * np.sqrt(speed * 0.02))


def test_scale_error_is_one_draw_a_run():
    skewed = EXACT.model_copy(update={"slip_scale": 0.03})
    scales = []
    for seed in range(200):
        base = SimulatedBase(skewed, None, (0.0, 0.0, 0.0), seed=seed)
        base.command(0.1, 0.0)
        drive(base, 10)
        legs, _, _ = drive(base, 2)
        assert legs[0].v == pytest.approx(legs[1].v, rel=1e-12)
        scales.append([(leg.v + s * 0.08 * leg.w) / 0.1 - 1 for leg in legs[:1] for s in (-1, 1)])
    within(np.ravel(scales), 0.03)


def test_gyro_noise_and_bias():
    noisy = EXACT.model_copy(update={"gyro_noise": 1e-3, "gyro_bias": 0.02})
    biases = []
    for seed in range(100):
        base = SimulatedBase(noisy, None, (0.0, 0.0, 0.0), seed=seed)
        _, readings, _ = drive(base, 200)
        rates = np.array([r.yaw_rate for r in readings])
        biases.append(rates.mean())
        if seed == 0:
            within(np.diff(rates) / np.sqrt(2), 1e-3 / np.sqrt(0.02), level=0.999999)  # neighbours share one
    within(np.array(biases), np.hypot(0.02, 1e-3 / np.sqrt(4.0)))


@pytest.mark.parametrize("gyro", [True, False])
def test_odometry_covariance_is_that_of_its_errors(gyro):
    """Errors of single steps, whitened by the claimed covariance, have the unit sphere's statistics."""
    noisy = BaseParameters(slip=0.003, slip_scale=0.0, gyro_bias=0.0, gyro_noise=1e-3, ticks=0)
    base = SimulatedBase(noisy, None, (0.0, 0.0, 0.0), seed=11)
    reckoning = DeadReckoning(noisy, gyro=gyro, covariance=True)
    base.command(0.15, -0.6)
    drive(base, 20, reckoning)
    white = []
    for _ in range(2000):
        true_before, before = base.pose, reckoning.pose
        _, _, (message,) = drive(base, 1, reckoning)
        error = np.subtract(relative(before, reckoning.pose), relative(true_before, base.pose))
        # Distance and turn: the third direction has no error within a step.
        c = message.covariance
        direction = np.array([(np.cos(-0.006), np.sin(-0.006), 0.0), (0.0, 0.0, 1.0)])
        white.append(np.linalg.solve(np.linalg.cholesky(direction @ c @ direction.T), direction @ error))
        assert np.linalg.eigvalsh(c).min() > -1e-18
    within(np.array(white)[:, 0], 1.0)
    within(np.array(white)[:, 1], 1.0)


def test_after_a_metre_the_claimed_variance_is_that_of_all_errors():
    """Scale error and white slip together, over 400 runs of 1 m: the length the model is made for."""
    noisy = BaseParameters(slip=0.004, slip_scale=0.006, ticks=0, acceleration=1e6)
    errors, claimed = [], 0.0
    for seed in range(400):
        base = SimulatedBase(noisy, None, (0.0, 0.0, 0.0), seed)
        base.command(0.2, 0.0)
        reckoning = DeadReckoning(noisy, gyro=False, covariance=True)
        claimed = 0.0
        for k in range(50):
            _, reading = base.step(k * 5 * STEP, (k + 1) * 5 * STEP)
            message = reckoning.update(0, reading.left, reading.right, reading.yaw_rate, 0.1)
            claimed += message.covariance[2, 2]
        errors.append(relative(base.pose, reckoning.pose)[2])
    within(np.array(errors), np.sqrt(claimed))


def test_an_obstacle_stops_the_body_but_not_the_wheels():
    room = RayCaster(World("room", box(-1, -1, 1, 1)))
    base = SimulatedBase(EXACT, room, (0.0, 0.0, 0.0), seed=1)
    base.command(0.2, 0.0)
    _, readings, _ = drive(base, 400)
    assert base.blocked
    assert base.pose[0] == pytest.approx(1 - 0.105, abs=0.2 * 0.02)
    assert room.clearance(*base.pose[:2]) > 0.105 - 1e-12
    assert readings[-1].left * 0.033 > 1.5  # 8 s of spinning wheels
    base.command(-0.2, 0.0)
    drive(base, 100)
    assert not base.blocked
    assert base.pose[0] < 0.7


def test_same_seed_same_run():
    def poses(seed):
        base = SimulatedBase(BaseParameters(), None, (0.0, 0.0, 0.0), seed)
        base.command(0.1, 0.3)
        return [leg.pose for leg in drive(base, 100)[0]]

    assert poses(4) == poses(4)
    assert poses(4) != poses(5)
