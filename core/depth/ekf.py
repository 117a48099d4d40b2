"""Extended Kalman filter in (x, y, chi) for each feature; the prediction is the exact rigid motion."""

import numpy as np

from knotwork.core.depth.observer import CHI_MAX, CHI_MIN
from knotwork.core.kernel import kernel
from knotwork.core.messages import F64


@kernel
def ekf_start(state: F64, covariance: F64, i: int, x: float, y: float, chi: float, sd: float, chi_sd: float) -> None:
    """Start the filter of feature i at its first measurement; standard deviations `sd` (image), `chi_sd` [1/m]."""
    state[i, 0] = x
    state[i, 1] = y
    state[i, 2] = chi
    covariance[i] = 0.0
    covariance[i, 0, 0] = sd * sd
    covariance[i, 1, 1] = sd * sd
    covariance[i, 2, 2] = chi_sd * chi_sd


@kernel
def ekf_step(
    state: F64,
    covariance: F64,
    measured: F64,
    seen: F64,
    rotation: F64,
    shift: F64,
    h: float,
    sd: float,
    q_s: float,
    q_chi: float,
) -> None:
    """Predict over a rigid step and correct by the measured points, in place.

    Parameters
    ----------
    state, covariance
        (x, y, chi) of each feature (n, 3), and (n, 3, 3).
    measured, seen
        Image points (n, 2) and 1 where there is one (n,).
    rotation, shift, h
        The step as of `camera.rigid_step`, and its length [s].
    sd
        Standard deviation of a measured coordinate.
    q_s, q_chi
        Growth of the standard deviation of the image position, and of chi relative to chi [1/sqrt(s)].
    """
    jac = np.empty((3, 3))
    tmp = np.empty((3, 3))
    for i in range(state.shape[0]):
        x, y, chi = state[i, 0], state[i, 1], state[i, 2]
        a, b, c = x - chi * shift[0], y - chi * shift[1], 1.0 - chi * shift[2]
        m0 = rotation[0, 0] * a + rotation[1, 0] * b + rotation[2, 0] * c
        m1 = rotation[0, 1] * a + rotation[1, 1] * b + rotation[2, 1] * c
        m2 = rotation[0, 2] * a + rotation[1, 2] * b + rotation[2, 2] * c
        p = covariance[i]
        if m2 > 1e-6:
            # dm/dx, dm/dy are rows 0 and 1 of the rotation; dm/dchi = -rotation^T shift
            for k in range(3):
                dm0, dm1, dm2 = rotation[k, 0], rotation[k, 1], rotation[k, 2]
                if k == 2:
                    dm0 = -(rotation[0, 0] * shift[0] + rotation[1, 0] * shift[1] + rotation[2, 0] * shift[2])
                    dm1 = -(rotation[0, 1] * shift[0] + rotation[1, 1] * shift[1] + rotation[2, 1] * shift[2])
                    dm2 = -(rotation[0, 2] * shift[0] + rotation[1, 2] * shift[1] + rotation[2, 2] * shift[2])
                jac[0, k] = (dm0 - m0 / m2 * dm2) / m2
                jac[1, k] = (dm1 - m1 / m2 * dm2) / m2
                jac[2, k] = -chi * dm2 / (m2 * m2)
            jac[2, 2] += 1.0 / m2
            for r in range(3):
                for k in range(3):
                    tmp[r, k] = jac[r, 0] * p[0, k] + jac[r, 1] * p[1, k] + jac[r, 2] * p[2, k]
            for r in range(3):
                for k in range(3):
                    p[r, k] = tmp[r, 0] * jac[k, 0] + tmp[r, 1] * jac[k, 1] + tmp[r, 2] * jac[k, 2]
            x, y, chi = m0 / m2, m1 / m2, chi / m2
        p[0, 0] += q_s * q_s * h
        p[1, 1] += q_s * q_s * h
        p[2, 2] += (q_chi * chi) ** 2 * h
        if seen[i] != 0.0:
            s00, s01, s11 = p[0, 0] + sd * sd, p[0, 1], p[1, 1] + sd * sd
            det = s00 * s11 - s01 * s01
            dx, dy = measured[i, 0] - x, measured[i, 1] - y
            for r in range(3):
                tmp[r, 0] = (p[r, 0] * s11 - p[r, 1] * s01) / det
                tmp[r, 1] = (p[r, 1] * s00 - p[r, 0] * s01) / det
            x += tmp[0, 0] * dx + tmp[0, 1] * dy
            y += tmp[1, 0] * dx + tmp[1, 1] * dy
            chi += tmp[2, 0] * dx + tmp[2, 1] * dy
            # Joseph's form: (I - K H) P (I - K H)^T + K R K^T stays positive definite
            for r in range(3):
                for k in range(3):
                    jac[r, k] = p[r, k] - tmp[r, 0] * p[0, k] - tmp[r, 1] * p[1, k]
            for r in range(3):
                for k in range(r + 1):
                    value = jac[r, k] - jac[r, 0] * tmp[k, 0] - jac[r, 1] * tmp[k, 1]
                    value += sd * sd * (tmp[r, 0] * tmp[k, 0] + tmp[r, 1] * tmp[k, 1])
                    p[r, k] = value
                    p[k, r] = value
        state[i, 0] = x
        state[i, 1] = y
        state[i, 2] = min(max(chi, CHI_MIN), CHI_MAX)
