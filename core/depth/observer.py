"""The fixed-gain observer of image position and inverse depth (8.12), its gain (8.34) and certainty (9.41)."""

import numpy as np
from numpy.typing import NDArray

from knotwork.core.camera import move_image
from knotwork.core.kernel import kernel
from knotwork.core.messages import F64

Flags = NDArray[np.bool_]

CHI_MIN, CHI_MAX = 0.05, 20.0  # 1/m; the estimate is kept in between, so chi <= 0 never occurs
CRITICAL = 0.0  # as `k_chi`: take the critically damped gain


@kernel
def critical_gain(k_s: float, psi: float, psi_rate: float, sigma2: float, floor: float) -> float:
    """Return k_chi [1/m^2] that damps the depth error critically (8.34).

    `psi` = J_l w [1/s] and its derivative [1/s^2], `sigma2` [m^2/s^2] bounded from below by `floor`.
    """
    return ((k_s + psi) ** 2 / 4.0 + psi_rate) / max(sigma2, floor)


@kernel
def fixed_gain_step(
    s_hat: F64,
    chi_hat: F64,
    before: F64,
    after: F64,
    seen: F64,
    v: F64,
    w: F64,
    rotation: F64,
    shift: F64,
    h: float,
    k_s: float,
    k_chi: float,
    floor: float,
) -> None:
    """Advance the observer (8.12) by one frame, in place.

    The observer is linear in (s_hat, chi_hat) but for v_z chi_hat^2; the trapezoid rule with the image
    position at mid-step keeps the continuous poles and is stable for every gain and frame rate. A feature
    that is not seen moves rigidly with its estimate.

    Parameters
    ----------
    s_hat, chi_hat
        Estimates (n, 2) and (n,) [1/m].
    before
        Image points (n, 2) of the last frame; becomes that of this frame.
    after, seen
        Measured image points (n, 2) of this frame, and 1 where there is one (n,).
    v, w, rotation, shift, h
        Twist over the step [m/s, rad/s], its rigid motion, and its length [s].
    k_s, k_chi, floor
        Gains [1/s, 1/m^2]; `k_chi` = 0 takes the critically damped one with `floor` for sigma^2.
    """
    half = 0.5 * h
    alpha = 1.0 + half * k_s
    for i in range(chi_hat.shape[0]):
        if seen[i] == 0.0:
            move_image(s_hat, chi_hat, rotation, shift, i)
            chi_hat[i] = min(max(chi_hat[i], CHI_MIN), CHI_MAX)
            before[i, 0] = s_hat[i, 0]
            before[i, 1] = s_hat[i, 1]
            continue
        x = 0.5 * (before[i, 0] + after[i, 0])
        y = 0.5 * (before[i, 1] + after[i, 1])
        om_x = x * v[2] - v[0]
        om_y = y * v[2] - v[1]
        sigma2 = om_x * om_x + om_y * om_y
        psi = y * w[0] - x * w[1]
        gain = k_chi
        if k_chi == CRITICAL:
            gain = critical_gain(k_s, psi, 0.0, sigma2, floor)
        # Beyond one doubling a step the trapezoid of a growing mode is meaningless.
        a = min(psi + v[2] * chi_hat[i], 1.0 / h)
        flow_x = x * y * w[0] - (1.0 + x * x) * w[1] + y * w[2] + k_s * x
        flow_y = (1.0 + y * y) * w[0] - x * y * w[1] - x * w[2] + k_s * y
        sx, sy, c = s_hat[i, 0], s_hat[i, 1], chi_hat[i]
        rx = sx + half * (om_x * c - k_s * sx) + h * flow_x
        ry = sy + half * (om_y * c - k_s * sy) + h * flow_y
        rc = c + half * (a * c - gain * (om_x * sx + om_y * sy)) + h * gain * (om_x * x + om_y * y)
        rc -= half * gain * (om_x * rx + om_y * ry) / alpha
        c = rc / (1.0 - half * a + half * half * gain * sigma2 / alpha)
        s_hat[i, 0] = (rx + half * om_x * c) / alpha
        s_hat[i, 1] = (ry + half * om_y * c) / alpha
        chi_hat[i] = min(max(c, CHI_MIN), CHI_MAX)
        before[i, 0] = after[i, 0]
        before[i, 1] = after[i, 1]


@kernel
def uncertainty_step(window: F64, count: F64, after: F64, s_hat: F64, seen: F64, energy: F64) -> None:
    """Write E (n,): the mean of |s - s_hat|^2 over the last frames in which a feature was seen (9.41).

    `window` (n, T) and `count` (n,) are the memory. E is infinite until the window is full: at the start
    s_hat = s says nothing about the depth.
    """
    length = window.shape[1]
    for i in range(energy.shape[0]):
        if seen[i] != 0.0:
            dx = after[i, 0] - s_hat[i, 0]
            dy = after[i, 1] - s_hat[i, 1]
            window[i, int(count[i]) % length] = dx * dx + dy * dy
            count[i] += 1.0
        if count[i] < length:
            energy[i] = np.inf
        else:
            total = 0.0
            for k in range(length):
                total += window[i, k]
            energy[i] = total / length


@kernel
def certainty_of_energy(energy: F64, lower: float, upper: float, rho: F64) -> None:
    """Write rho (n,) in [0, 1]: 1 where E <= `lower`, 0 where E >= `upper`, linear between (9.43), (9.45)."""
    for i in range(rho.shape[0]):
        rho[i] = min(max((upper - energy[i]) / (upper - lower), 0.0), 1.0)


@kernel
def certainty_of_variance(variance: F64, chi: F64, lower: float, upper: float, rho: F64) -> None:
    """Write rho (n,) in [0, 1] by the relative standard deviation of chi: 1 at `lower`, 0 at `upper`."""
    for i in range(rho.shape[0]):
        relative = np.sqrt(variance[i]) / chi[i]
        rho[i] = min(max((upper - relative) / (upper - lower), 0.0), 1.0)


@kernel
def convergence_conditions(s: F64, v: F64, w: F64, minimum: float, sigma2: F64, conditions: Flags) -> None:
    """Write sigma^2 (n,) and which conditions of Theorem 8.2 hold for each point (n, 3).

    The columns: v_z <= 0; J_l(s) w <= 0; sigma^2 >= `minimum` [m^2/s^2]. The second one is given 2 % of |w|,
    because w was chosen for the image of a frame ago.
    """
    slack = 0.02 * np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    for i in range(sigma2.shape[0]):
        om_x = s[i, 0] * v[2] - v[0]
        om_y = s[i, 1] * v[2] - v[1]
        sigma2[i] = om_x * om_x + om_y * om_y
        conditions[i, 0] = v[2] <= 1e-12
        conditions[i, 1] = s[i, 1] * w[0] - s[i, 0] * w[1] <= slack
        conditions[i, 2] = sigma2[i] >= minimum
