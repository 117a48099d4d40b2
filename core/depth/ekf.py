"""Extended Kalman filter in (x, y, chi) for each feature; the prediction is the exact rigid motion."""

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
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    t0, t1, t2 = shift[0], shift[1], shift[2]
    # With m = rotation^T ((x, y, 1) - chi shift): dm/dx, dm/dy are rows 0 and 1 of the rotation, dm/dchi is d.
    d0 = -(r00 * t0 + r10 * t1 + r20 * t2)
    d1 = -(r01 * t0 + r11 * t1 + r21 * t2)
    d2 = -(r02 * t0 + r12 * t1 + r22 * t2)
    variance = sd * sd
    # Scalars all through, six for a symmetric matrix: nothing of 3 x 3 goes through memory.
    for i in range(state.shape[0]):
        x, y, chi = state[i, 0], state[i, 1], state[i, 2]
        p00, p01, p02 = covariance[i, 0, 0], covariance[i, 0, 1], covariance[i, 0, 2]
        p11, p12, p22 = covariance[i, 1, 1], covariance[i, 1, 2], covariance[i, 2, 2]
        m0 = r00 * x + r10 * y + r20 + chi * d0
        m1 = r01 * x + r11 * y + r21 + chi * d1
        m2 = r02 * x + r12 * y + r22 + chi * d2
        if m2 > 1e-6:
            per = 1.0 / m2
            x, y, chi = m0 * per, m1 * per, chi * per
            a0, a1, a2 = (r00 - x * r02) * per, (r10 - x * r12) * per, (d0 - x * d2) * per
            b0, b1, b2 = (r01 - y * r02) * per, (r11 - y * r12) * per, (d1 - y * d2) * per
            c0, c1, c2 = -chi * r02 * per, -chi * r12 * per, (1.0 - chi * d2) * per
            u0, u1, u2 = a0 * p00 + a1 * p01 + a2 * p02, a0 * p01 + a1 * p11 + a2 * p12, a0 * p02 + a1 * p12 + a2 * p22
            v0, v1, v2 = b0 * p00 + b1 * p01 + b2 * p02, b0 * p01 + b1 * p11 + b2 * p12, b0 * p02 + b1 * p12 + b2 * p22
            w0, w1, w2 = c0 * p00 + c1 * p01 + c2 * p02, c0 * p01 + c1 * p11 + c2 * p12, c0 * p02 + c1 * p12 + c2 * p22
            p00, p01, p02 = u0 * a0 + u1 * a1 + u2 * a2, u0 * b0 + u1 * b1 + u2 * b2, u0 * c0 + u1 * c1 + u2 * c2
            p11, p12 = v0 * b0 + v1 * b1 + v2 * b2, v0 * c0 + v1 * c1 + v2 * c2
            p22 = w0 * c0 + w1 * c1 + w2 * c2
        p00 += q_s * q_s * h
        p11 += q_s * q_s * h
        p22 += (q_chi * chi) ** 2 * h
        if seen[i] != 0.0:
            s00, s11 = p00 + variance, p11 + variance
            per = 1.0 / (s00 * s11 - p01 * p01)
            k00, k01 = (p00 * s11 - p01 * p01) * per, (p01 * s00 - p00 * p01) * per
            k10, k11 = (p01 * s11 - p11 * p01) * per, (p11 * s00 - p01 * p01) * per
            k20, k21 = (p02 * s11 - p12 * p01) * per, (p12 * s00 - p02 * p01) * per
            dx, dy = measured[i, 0] - x, measured[i, 1] - y
            x += k00 * dx + k01 * dy
            y += k10 * dx + k11 * dy
            chi += k20 * dx + k21 * dy
            # Joseph's form: (I - K H) P (I - K H)^T + K R K^T stays positive definite
            e00, e01 = p00 - k00 * p00 - k01 * p01, p01 - k00 * p01 - k01 * p11
            e10, e11 = p01 - k10 * p00 - k11 * p01, p11 - k10 * p01 - k11 * p11
            e20, e21, e22 = p02 - k20 * p00 - k21 * p01, p12 - k20 * p01 - k21 * p11, p22 - k20 * p02 - k21 * p12
            p00 = e00 - e00 * k00 - e01 * k01 + variance * (k00 * k00 + k01 * k01)
            p01 = e10 - e10 * k00 - e11 * k01 + variance * (k10 * k00 + k11 * k01)
            p02 = e20 - e20 * k00 - e21 * k01 + variance * (k20 * k00 + k21 * k01)
            p11 = e11 - e10 * k10 - e11 * k11 + variance * (k10 * k10 + k11 * k11)
            p12 = e21 - e20 * k10 - e21 * k11 + variance * (k20 * k10 + k21 * k11)
            p22 = e22 - e20 * k20 - e21 * k21 + variance * (k20 * k20 + k21 * k21)
        state[i, 0] = x
        state[i, 1] = y
        state[i, 2] = min(max(chi, CHI_MIN), CHI_MAX)
        covariance[i, 0, 0], covariance[i, 0, 1], covariance[i, 0, 2] = p00, p01, p02
        covariance[i, 1, 0], covariance[i, 1, 1], covariance[i, 1, 2] = p01, p11, p12
        covariance[i, 2, 0], covariance[i, 2, 1], covariance[i, 2, 2] = p02, p12, p22
