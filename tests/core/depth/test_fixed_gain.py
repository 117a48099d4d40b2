import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from knotwork.core.camera import excitation, interaction, move_points, project, rigid_step
from knotwork.core.depth.observer import (
    CHI_MAX,
    CHI_MIN,
    CRITICAL,
    certainty_of_energy,
    certainty_of_variance,
    convergence_conditions,
    critical_gain,
    fixed_gain_step,
    uncertainty_step,
)

V, W = np.array((0.06, -0.05, -0.03)), np.array((0.05, -0.08, 0.1))


def observe(q, v, w, h, frames, guess, k_s=10.0, k_chi=2500.0, floor=1e-4, seen=lambda k: 1.0):
    """Return true and estimated inverse depth of each frame."""
    q = np.array(q, dtype=float).reshape(1, 3)
    s_hat, chi_hat = project(q)[0].copy(), np.full(1, guess)
    before = s_hat.copy()
    rotation, shift = np.eye(3), np.zeros(3)
    rigid_step(v, w, h, rotation, shift)
    out = [(1 / q[0, 2], guess)]
    for k in range(frames):
        move_points(q, rotation, shift)
        s, chi = project(q)
        arguments = (np.full(1, seen(k)), v, w, rotation, shift, h, k_s, k_chi, floor)
        fixed_gain_step(s_hat, chi_hat, before, s, *arguments)
        out.append((chi[0], chi_hat[0]))
    return np.array(out)


def test_it_follows_the_differential_equation_it_discretises():
    q0, guess, end = np.array((0.3, -0.2, 1.2)), 0.3, 2.0

    def rate(t, x):
        q, s_hat, chi_hat = x[:3], x[3:5], x[5]
        s, _ = project(q)
        flow = interaction(s, np.ones(1))
        om = flow[:, :3] @ V
        s_rate = flow[:, 3:] @ W + chi_hat * om + 10.0 * (s[0] - s_hat)
        psi = s[0, 1] * W[0] - s[0, 0] * W[1]
        chi_rate = chi_hat**2 * V[2] + chi_hat * psi + 2500.0 * om @ (s[0] - s_hat)
        return np.concatenate((-V - np.cross(W, q), s_rate, (chi_rate,)))

    start = np.concatenate((q0, project(q0)[0][0], (guess,)))
    exact = solve_ivp(rate, (0, end), start, t_eval=np.linspace(0, end, 41), rtol=1e-9, atol=1e-11).y[5]
    errors = [np.abs(observe(q0, V, W, 0.05 / m, 40 * m, guess)[::m, 1] - exact).max() for m in (1, 2, 4)]
    assert errors[0] < 0.02
    assert errors[1] / errors[0] == pytest.approx(0.25, abs=0.1)  # second order
    assert errors[2] / errors[1] == pytest.approx(0.25, abs=0.1)


@pytest.mark.parametrize("h", [1e-3, 0.02, 0.05, 0.2, 1.0])
@pytest.mark.parametrize("k_chi", [CRITICAL, 10.0, 2500.0, 2e4, 1e7])
def test_no_gain_and_no_frame_rate_makes_it_unstable(h, k_chi):
    v, w = np.array((0.1, 0.0, 0.0)), np.zeros(3)
    frames = 400
    sway = observe((0.0, 0.1, 1.0), v, w, h, min(frames, int(6 / h)), 0.1, k_chi=k_chi)
    assert ((sway[:, 1] >= CHI_MIN) & (sway[:, 1] <= CHI_MAX)).all()
    wrong = np.abs(sway[:, 1] - sway[:, 0])
    assert wrong[-1] <= wrong.max() * 1.0001
    if k_chi >= 2500.0 or k_chi == CRITICAL:
        assert wrong[len(wrong) // 2 :].max() <= 0.9


@pytest.mark.parametrize("depth", [0.4, 1.0, 3.0])
def test_the_critical_gain_damps_critically_at_any_speed(depth):
    for speed in (0.05, 0.2):
        run = observe((0.0, 0.0, depth), np.array((speed, 0.0, 0.0)), np.zeros(3), 0.01, 400, 0.1, k_chi=CRITICAL)
        wrong = run[:, 0] - run[:, 1]
        # double pole at -k_s/2: (1 + 5 t) exp(-5 t)
        t = 0.01 * np.arange(401)
        np.testing.assert_allclose(wrong / wrong[0], (1 + 5 * t) * np.exp(-5 * t), atol=2e-3)
    assert critical_gain(10.0, 0.0, 0.0, 0.01, 1e-4) == pytest.approx(2500.0)
    assert critical_gain(10.0, -0.5, 0.2, 1e-9, 1e-3) == pytest.approx((9.5**2 / 4 + 0.2) / 1e-3)


def test_an_unseen_point_moves_with_the_camera():
    run = observe((0.2, 0.1, 1.0), V, W, 0.05, 60, 1.0, seen=lambda k: float(k < 5 or k > 40))
    np.testing.assert_allclose(run[:, 0], run[:, 1], atol=2e-5)


def test_the_uncertainty_is_infinite_until_its_window_is_full_and_then_a_mean():
    rng = np.random.default_rng(3)
    window, count, energy = np.zeros((2, 4)), np.zeros(2), np.zeros(2)
    kept = [[], []]
    for k in range(12):
        seen = np.array((1.0, float(k % 2)))
        s, s_hat = rng.normal(size=(2, 2)), rng.normal(size=(2, 2))
        uncertainty_step(window, count, s, s_hat, seen, energy)
        for i in range(2):
            if seen[i]:
                kept[i].append(float(((s[i] - s_hat[i]) ** 2).sum()))
            expected = math.inf if len(kept[i]) < 4 else np.mean(kept[i][-4:])
            assert energy[i] == pytest.approx(expected)


def test_certainty_is_linear_between_its_bounds():
    rho = np.zeros(5)
    certainty_of_energy(np.array((np.inf, 1e-5, 1e-6, 5.5e-7, 1e-8)), 1e-7, 1e-6, rho)
    np.testing.assert_allclose(rho, (0, 0, 0, 0.5, 1), atol=1e-12)
    certainty_of_variance(np.array((1.0, 0.04, 0.015625, 0.0025, 1e-6)), np.ones(5), 0.05, 0.2, rho)
    np.testing.assert_allclose(rho, (0, 0, 0.5, 1, 1), atol=1e-12)


def conditions(s, v, w, minimum):
    sigma2, out = np.empty(len(s)), np.empty((len(s), 3), dtype=bool)
    convergence_conditions(s, np.array(v), np.array(w), minimum, sigma2, out)
    np.testing.assert_allclose(sigma2, excitation(s, np.array(v)), atol=1e-15)
    return out


def test_the_conditions_of_convergence():
    s = np.array([(0.3, 0.0), (-0.3, 0.0), (0.0, 0.0)])
    got = conditions(s, (0.0, 0.0, -0.1), (0.0, 0.1, 0.0), 1e-4)
    np.testing.assert_array_equal(got[:, 0], True)
    np.testing.assert_array_equal(got[:, 1], (True, False, True))  # -x w_y <= 0
    np.testing.assert_array_equal(got[:, 2], (True, True, False))  # the focus of expansion shows nothing
    assert not conditions(s, (0.0, 0.0, 0.1), (0.0, 0.0, 0.0), 0.0)[:, 0].any()
