"""The only place that asks the operating system for the time."""

import time

_EPOCH_OFFSET = time.time_ns() - time.monotonic_ns()


def monotonic() -> int:
    """Return a monotone clock [ns]; for durations and time-outs."""
    return time.monotonic_ns()


def epoch() -> int:
    """Return nanoseconds since 1970 that never step back while this process lives; for device stamps."""
    return _EPOCH_OFFSET + time.monotonic_ns()
