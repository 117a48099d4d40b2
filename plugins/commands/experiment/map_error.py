"""How wrong a map is about walls that are known, through the eyes of what aligns scans to it."""

import numpy as np

from knotwork.core.contracts import Map
from knotwork.core.messages import F64
from knotwork.plugins.commands.experiment.bare_map import turn

FAR = 1e3  # m: where no map knows anything
_REACH = 100.0  # m: of the scans that ask
_FLAT = 1e-3  # of the profile's height: what counts as its bottom


def residual_error(chart: Map, ranges: F64) -> float:
    """Return the mapping error (7.23): mean squared residual of the true scan at the true pose (the origin).

    In units of the residual of a place of which the map knows nothing: 0 perfect, 1 nothing known.

    Parameters
    ----------
    ranges : shape (n,)
        True distances [m] to the wall in each direction of a turn.
    """
    alignment = chart.alignment(turn(ranges, _REACH), np.zeros(3))
    found, _ = alignment.residuals(np.zeros(3), 0)
    unknown, _ = alignment.residuals(np.array([FAR, FAR, 0.0]), 0)
    return float(np.mean((found / unknown) ** 2))


def range_errors(chart: Map, ranges: F64, window: float, step: float) -> F64:
    """Return by how much the map's wall lies beyond the true one along each beam: shape (n,) [m].

    The map's wall is where a beam's residual is smallest, the middle of it if that is a whole stretch.

    Parameters
    ----------
    window, step
        It is looked for this far before and behind the true wall [m], in such steps [m].
    """
    shifts = np.linspace(-window, window, 2 * round(window / step) + 1)
    profile = np.empty((len(shifts), len(ranges)))
    for row, shift in zip(profile, shifts, strict=True):
        row[:] = np.abs(chart.alignment(turn(ranges + shift, _REACH), np.zeros(3)).residuals(np.zeros(3), 0)[0])
    low, high = profile.min(axis=0), profile.max(axis=0)
    bottom = profile <= low + _FLAT * (high - low)
    middle: F64 = (shifts[:, None] * bottom).sum(axis=0) / bottom.sum(axis=0)
    return middle
