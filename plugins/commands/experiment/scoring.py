"""Figures of merit of many runs."""

import math
from collections.abc import Sequence


def wilson(successes: int, runs: int) -> tuple[float, float]:
    """Return the 95 % interval of a probability (Wilson's score interval)."""
    z = 1.959964
    p = successes / runs
    middle = (p + z * z / (2 * runs)) / (1 + z * z / runs)
    half = z / (1 + z * z / runs) * math.sqrt(p * (1 - p) / runs + z * z / (4 * runs * runs))
    # At p = 0 and 1 rounding would leave the interval short of its end.
    return (0.0 if successes == 0 else middle - half), (1.0 if successes == runs else middle + half)


def median(values: Sequence[float]) -> float | None:
    """Return the median; None of nothing."""
    if not values:
        return None
    ordered = sorted(values)
    middle = len(ordered) // 2
    return ordered[middle] if len(ordered) % 2 else 0.5 * (ordered[middle - 1] + ordered[middle])
