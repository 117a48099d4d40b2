"""The only place that asks the operating system for the time."""

import os
import time

_IMPORTED = time.monotonic_ns()
_EPOCH_OFFSET = time.time_ns() - time.monotonic_ns()


monotonic = time.monotonic_ns
"""Monotone clock [ns], for durations and time-outs."""


def epoch() -> int:
    """Return nanoseconds since 1970 that never step back while this process lives; for device stamps."""
    return _EPOCH_OFFSET + time.monotonic_ns()


def since_process_start() -> int:
    """Return how long this process has lived [ns]; since this module was imported where that is unknown."""
    try:
        with open("/proc/self/stat") as stat:
            started = int(stat.read().rpartition(")")[2].split()[19]) / os.sysconf("SC_CLK_TCK")
        return round((time.clock_gettime(time.CLOCK_BOOTTIME) - started) * 1e9)
    except (OSError, ValueError, AttributeError, IndexError):
        return time.monotonic_ns() - _IMPORTED
