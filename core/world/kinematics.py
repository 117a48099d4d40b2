"""Differential drive in closed form: arcs, wheel speeds, limits and ramps. Rim speeds are in m/s."""

from collections.abc import Sequence
from math import cos, sin

from knotwork.core.geometry import Pose2, wrap


def arc(pose: Sequence[float], length: float, turn: float) -> Pose2:
    """Return the pose after an exact circular arc.

    Parameters
    ----------
    pose
        x [m], y [m], yaw [rad].
    length
        Distance along the arc, negative backwards [m].
    turn
        Change of yaw [rad].
    """
    half = 0.5 * turn
    # Chord of the arc; the series is exact to double precision below 1e-3 rad.
    chord = length * (sin(half) / half if abs(half) > 1e-3 else 1.0 - half * half * (1.0 - half * half / 20) / 6)
    x, y, yaw = pose
    return x + chord * cos(yaw + half), y + chord * sin(yaw + half), wrap(yaw + turn)


def wheel_speeds(v: float, w: float, separation: float) -> tuple[float, float]:
    """Return rim speeds, left and right [m/s], of a forward speed [m/s] and a yaw rate [rad/s]."""
    return v - 0.5 * separation * w, v + 0.5 * separation * w


def body_twist(left: float, right: float, separation: float) -> tuple[float, float]:
    """Return forward speed [m/s] and yaw rate [rad/s] for rim speeds [m/s]."""
    return 0.5 * (left + right), (right - left) / separation


def limited(left: float, right: float, fastest: float) -> tuple[float, float]:
    """Slow both wheels by one factor so that neither exceeds `fastest` [m/s]: the curvature is kept."""
    factor = min(1.0, fastest / max(abs(left), abs(right), fastest))
    return left * factor, right * factor


def ramped(speed: float, target: float, up: float, down: float) -> float:
    """Move `speed` towards `target` by at most `up` away from zero and `down` towards it [m/s].

    A change of sign stops at zero first.
    """
    if speed * target < 0.0:
        target = 0.0
    change = up if abs(target) > abs(speed) else down
    return min(max(target, speed - change), speed + change)
