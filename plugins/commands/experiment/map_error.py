"""How wrong a map is about walls that are known, through the eyes of what aligns scans to it."""

from collections.abc import Callable

import numpy as np

from knotwork.core.contracts import Alignment, Map
from knotwork.core.messages import F64
from knotwork.plugins.commands.experiment.bare_map import turn

FAR = 1e3  # m: where no map knows anything
_REACH = 100.0  # m: of the scans that ask
_FLAT = 1e-3  # of the profile's height: what counts as its bottom
_PLACES = np.array([(0.37, -0.21, 0.3), (-0.55, 0.42, -1.1), (0.13, 0.66, 2.0)])  # off the middle, not symmetric
_OFF = (0.03, np.radians(1.0))  # m, rad: of the starts
_STARTS, _STEPS = 8, 50


def residual_error(chart: Map, ranges: F64, window: float = 0.0, step: float = 0.01) -> float:
    """Return the mapping error (7.23), the mean of (1 - s / c)^2 over the ends of the true scan from the origin.

    s is what the map holds there and c its bound: 0 perfect, 1 nothing known.

    Parameters
    ----------
    ranges : shape (n,)
        True distances [m] to the wall in each direction of a turn.
    window, step
        Above 0, for a map that was not bounded: c is the most that it holds on these beams so far before and
        behind the true wall [m], in such steps [m].
    """
    shifts = np.linspace(-window, window, 2 * round(window / step) + 1)
    held = 1.0 - _profile(chart, ranges, shifts) / _unknown(chart, ranges)
    bound = float(held.max()) if window > 0.0 else 1.0
    return float(np.mean((1.0 - held[len(shifts) // 2] / bound) ** 2))


def range_errors(chart: Map, ranges: F64, window: float, step: float) -> F64:
    """Return by how much the map's wall lies beyond the true one along each beam: shape (n,) [m].

    The map's wall is where a beam's residual is smallest, the middle of it if that is a whole stretch.

    Parameters
    ----------
    window, step
        It is looked for this far before and behind the true wall [m], in such steps [m].
    """
    shifts = np.linspace(-window, window, 2 * round(window / step) + 1)
    profile = np.abs(_profile(chart, ranges, shifts))
    low, high = profile.min(axis=0), profile.max(axis=0)
    bottom = profile <= low + _FLAT * (high - low)
    middle: F64 = (shifts[:, None] * bottom).sum(axis=0) / bottom.sum(axis=0)
    return middle


def apart(found: F64, true: F64) -> float:
    """Return the distance [m] between two poses (3,)."""
    return float(np.hypot(*(found - true)[:2]))


def pose_error(chart: Map, ranges_at: Callable[[F64], F64], distance: Callable[[F64, F64], float] = apart) -> float:
    """Return the rms error [m] of true scans from other places, aligned by damped Gauss-Newton.

    Parameters
    ----------
    ranges_at
        Gives the true distances (n,) [m] of a turn from a pose (3,).
    distance
        How far [m] a pose (3,) is from the true one, in what the world can tell.
    """
    squares = []
    for place in _PLACES:
        alignment = chart.alignment(turn(ranges_at(place), _REACH), place)
        for angle in 2.0 * np.pi * np.arange(_STARTS) / _STARTS:
            turned = _OFF[1] * (1.0 if np.cos(3.0 * angle) > 0.0 else -1.0)
            start = place + np.array((_OFF[0] * np.cos(angle), _OFF[0] * np.sin(angle), turned))
            squares.append(distance(_aligned(alignment, start), place) ** 2)
    return float(np.sqrt(np.mean(squares)))


def _profile(chart: Map, ranges: F64, shifts: F64) -> F64:
    """Return the residuals (k, n) of beams that end `shifts` (k,) [m] beyond the true wall."""
    profile = np.empty((len(shifts), len(ranges)))
    for row, shift in zip(profile, shifts, strict=True):
        row[:] = chart.alignment(turn(ranges + shift, _REACH), np.zeros(3)).residuals(np.zeros(3), 0)[0]
    return profile


def _unknown(chart: Map, ranges: F64) -> F64:
    """Return the residuals (n,) where the map knows nothing."""
    found, _ = chart.alignment(turn(ranges, _REACH), np.zeros(3)).residuals(np.array([FAR, FAR, 0.0]), 0)
    return found


def _aligned(alignment: Alignment, start: F64) -> F64:
    """Return the pose of least cost near `start`; every step lowers the cost."""
    pose, damping = start, 1e-3
    found = alignment.normal_equations(pose, 0)
    for _ in range(_STEPS):
        diagonal = np.diag(found.H)
        step = -np.linalg.solve(found.H + np.diag(damping * diagonal + 1e-9 * (1.0 + diagonal.max())), found.g)
        tried = alignment.normal_equations(pose + step, 0)
        if tried.cost < found.cost:
            pose, found, damping = pose + step, tried, 0.3 * damping
            if np.abs(step).max() < 1e-7:
                break
        elif (damping := 10.0 * damping) > 1e8:
            break
    return pose
