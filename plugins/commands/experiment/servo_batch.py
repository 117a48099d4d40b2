"""One visual-servo scenario as a compiled loop over the kernels that the plugins call."""

import math

import numpy as np

from knotwork.core.camera import move_points, rigid_step
from knotwork.core.depth.ekf import ekf_start, ekf_step
from knotwork.core.depth.observer import (
    certainty_of_energy,
    certainty_of_variance,
    fixed_gain_step,
    uncertainty_step,
)
from knotwork.core.depth.servo import servo_problem, solve_cone
from knotwork.core.kernel import kernel
from knotwork.core.messages import F64

KNOWN, FIXED_GAIN, EKF = 0, 1, 2  # where the depths come from
TOO_NEAR = 0.05  # m; a point this near to the camera plane ends a run


@kernel
def run_servo(
    start: F64,
    goal: F64,
    guess: F64,
    estimator: int,
    constrained: bool,
    beta: float,
    gain: float,
    gains: F64,
    filter_sd: F64,
    thresholds: F64,
    window: int,
    h: float,
    limits: F64,
    noise: F64,
    seen: F64,
    twist_scale: F64,
    twist_noise: F64,
    errors: F64,
    phases: F64,
    chi_error: F64,
    path: F64,
) -> bool:
    """Run one scenario for as many steps as `twist_noise` (K, 6) has rows.

    Parameters
    ----------
    start, goal, guess
        Points (n, 3) [m] in the first camera frame, goal image (n, 2), guessed inverse depths (n,) [1/m].
    estimator, constrained, beta
        KNOWN, FIXED_GAIN or EKF; rows of (9.46); share of v_max of the excitation row, negative for none.
    gain, gains, filter_sd, thresholds, window
        lambda [1/s]; (k_s, k_chi, sigma^2 floor); the filter's (image sd, chi sd, q_s, q_chi);
        (lower, upper) of the certainty, of E or of the relative standard deviation; T in frames.
    h, limits
        Step [s]; (v_max, w_max).
    noise, seen
        Added to the measured image (K+1, n, 2); 1 where a point is seen (K+1, n).
    twist_scale, twist_noise
        The camera moves with `twist_scale` (6,) times the command plus `twist_noise`.
    errors, phases, chi_error, path
        Outputs of each frame: |e| without noise (K+1,), phase (K+1,), 0 where the program had no answer and the
        camera stood, estimate minus truth (K+1, n) [1/m],
        camera pose: position and rotation row by row (K+1, 12), in the first camera frame.

    Returns
    -------
    bool
        False if a point came too near to the camera plane; the outputs end there.
    """
    n = start.shape[0]
    steps = twist_noise.shape[0]
    points = start.copy()
    measured = np.empty((n, 2))
    before = np.empty((n, 2))
    s_hat = np.empty((n, 2))
    chi = guess.copy()
    state = np.empty((n, 3))
    covariance = np.zeros((n, 3, 3))
    variance = np.empty(n)
    memory = np.zeros((n, window))
    count = np.zeros(n)
    energy = np.full(n, np.inf)
    rho = np.zeros(n)
    known = np.zeros(n)
    released = np.zeros(n)
    lateral = np.zeros(2)
    hessian = np.empty((6, 6))
    gradient = np.empty(6)
    direction = np.empty(2)
    u = np.zeros(6)
    moved = np.empty(6)
    rotation = np.eye(3)
    shift = np.zeros(3)
    pose = np.eye(3)
    position = np.zeros(3)
    for k in range(steps + 1):
        if k > 0:
            for a in range(6):
                moved[a] = u[a] * twist_scale[a] + twist_noise[k - 1, a]
            rigid_step(moved[:3], moved[3:], h, rotation, shift)
            move_points(points, rotation, shift)
            position += pose @ shift
            pose = pose @ rotation
        path[k, :3] = position
        path[k, 3:] = pose.copy().reshape(9)
        total = 0.0
        for i in range(n):
            if points[i, 2] < TOO_NEAR:
                return False
            for a in range(2):
                measured[i, a] = points[i, a] / points[i, 2]
                total += (measured[i, a] - goal[i, a]) ** 2
                measured[i, a] += noise[k, i, a]
        errors[k] = math.sqrt(total)
        rigid_step(u[:3], u[3:], h, rotation, shift)  # what the observer believes
        if estimator == FIXED_GAIN:
            fixed_gain_step(
                s_hat,
                chi,
                before,
                measured,
                known * seen[k],
                u[:3],
                u[3:],
                rotation,
                shift,
                h,
                gains[0],
                gains[1],
                gains[2],
            )
            uncertainty_step(memory, count, measured, s_hat, known * seen[k], energy)
        elif estimator == EKF and k > 0:
            ekf_step(
                state,
                covariance,
                measured,
                known * seen[k],
                rotation,
                shift,
                h,
                filter_sd[0],
                filter_sd[2],
                filter_sd[3],
            )
        for i in range(n):
            if known[i] == 0.0 and seen[k, i] != 0.0:
                known[i] = 1.0
                s_hat[i] = measured[i]
                before[i] = measured[i]
                ekf_start(state, covariance, i, measured[i, 0], measured[i, 1], guess[i], filter_sd[0], filter_sd[1])
            if estimator == KNOWN:
                chi[i] = 1.0 / points[i, 2]
            elif estimator == EKF:
                chi[i] = state[i, 2]
                variance[i] = covariance[i, 2, 2]
            chi_error[k, i] = chi[i] - 1.0 / points[i, 2]
        if estimator == FIXED_GAIN:
            certainty_of_energy(energy, thresholds[0], thresholds[1], rho)
        elif estimator == EKF:
            certainty_of_variance(variance, chi, thresholds[0], thresholds[1], rho)
        else:
            rho[:] = 1.0
        view = np.nonzero(known * seen[k])[0]
        u[:] = 0.0
        if view.shape[0] > 0:
            s = measured[view]
            mine = released[view]
            bounds = np.empty(view.shape[0])
            _, v_z_bound, least = servo_problem(
                s, chi[view], goal[view], rho[view], mine, lateral, gain, limits[0], limits[1], beta,
                hessian, gradient, bounds, direction,
            )  # fmt: skip
            released[view] = mine
            phases[k] = 1.0 if rho[view].max() == 0.0 else (3.0 if rho[view].min() == 1.0 else 2.0)
            rows = s if constrained else s[:0]
            solved = solve_cone(
                hessian, gradient, rows, bounds[: rows.shape[0]], v_z_bound if constrained else np.inf,
                direction, least, limits[0], limits[1], u,
            )  # fmt: skip
            if not solved:
                phases[k] = 0.0
        lateral[0], lateral[1] = u[0], u[1]
    return True
