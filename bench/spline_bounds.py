"""What one core of this machine can do at most: multiply-adds and memory reads a second."""

import time

import numpy as np
from numba import njit


@njit(fastmath=True)
def _multiply_add(x, a, b, times):
    for _ in range(times):
        for k in range(x.shape[0]):  # long enough to hide the latency, short enough for the first cache
            x[k] = x[k] * a + b
            x[k] = x[k] * a + b
            x[k] = x[k] * a + b
            x[k] = x[k] * a + b
            x[k] = x[k] * a + b
            x[k] = x[k] * a + b
            x[k] = x[k] * a + b
            x[k] = x[k] * a + b


@njit(fastmath=True)
def _read(x):
    total = 0.0
    for k in range(x.shape[0]):
        total += x[k]
    return total


def _best(function, *arguments) -> float:
    function(*arguments)
    times = []
    for _ in range(7):
        start = time.perf_counter()
        function(*arguments)
        times.append(time.perf_counter() - start)
    return min(times)


def flops() -> float:
    """Return double-precision operations a second, multiply-adds counted as two."""
    n, times = 512, 4000
    return n * times * 16 / _best(_multiply_add, np.ones(n), 0.999, 0.001, times)


def bandwidth() -> float:
    """Return bytes a second of a sum over memory far larger than the caches."""
    data = np.ones(1 << 24)
    return data.nbytes / _best(_read, data)
