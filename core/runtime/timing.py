"""How long things take: nested spans, and histograms of constant size."""

from collections.abc import Callable
from math import log2
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

I64 = NDArray[np.int64]

_PER_OCTAVE = 32  # buckets of 2.2 % width


class Histogram:
    """Durations in logarithmic buckets: mean and maximum exact, percentiles to 1.1 %."""

    __slots__ = ("_buckets", "maximum", "n", "own", "total")

    def __init__(self) -> None:
        self._buckets: dict[int, int] = {}
        self.n = 0
        self.total = 0  # ns
        self.own = 0  # ns, without nested spans
        self.maximum = 0

    def add(self, duration: int, own: int) -> None:
        """Add a duration and its part outside nested spans [ns]."""
        self.n += 1
        self.total += duration
        self.own += own
        if duration > self.maximum:
            self.maximum = duration
        bucket = int(log2(duration + 1) * _PER_OCTAVE)
        buckets = self._buckets
        buckets[bucket] = buckets.get(bucket, 0) + 1

    def add_all(self, durations: I64, own: int) -> None:
        """Add durations (n,) [ns], of which `own` in all is outside nested spans."""
        self.n += len(durations)
        self.total += int(durations.sum())
        self.own += own
        self.maximum = max(self.maximum, int(durations.max(initial=0)))
        buckets = self._buckets
        for bucket in (np.log2(durations + 1) * _PER_OCTAVE).astype(np.int64).tolist():
            buckets[bucket] = buckets.get(bucket, 0) + 1

    def percentile(self, share: float) -> float:
        """Return the duration [ns] that `share` of all durations do not exceed."""
        return self.percentiles(share)[0]

    def percentiles(self, *shares: float) -> list[float]:
        """Return the durations [ns] of several shares, given in ascending order."""
        found: list[float] = []
        counted = 0
        for bucket, count in sorted(self._buckets.items()):
            counted += count
            while len(found) < len(shares) and counted >= shares[len(found)] * self.n:
                found.append(min(float(2 ** ((bucket + 0.5) / _PER_OCTAVE)), float(self.maximum)))
        return found + [float(self.maximum)] * (len(shares) - len(found))

    def counts(self) -> list[list[float]]:
        """Return (upper end [ms], count) of buckets a quarter of an octave wide; empty ones are left out."""
        wide = _PER_OCTAVE // 4
        counts: dict[int, int] = {}
        for bucket, n in sorted(self._buckets.items()):
            counts[bucket // wide] = counts.get(bucket // wide, 0) + n
        return [[2.0 ** ((bucket + 1) / 4) / 1e6, n] for bucket, n in counts.items()]

    def summary(self) -> dict[str, Any]:
        """Return n and mean, p50, p95, p99, max [ms]."""
        n = max(self.n, 1)
        p50, p95, p99 = self.percentiles(0.50, 0.95, 0.99)
        return {
            "n": self.n,
            "mean_ms": self.total / n / 1e6,
            "p50_ms": p50 / 1e6,
            "p95_ms": p95 / 1e6,
            "p99_ms": p99 / 1e6,
            "max_ms": self.maximum / 1e6,
            "self_mean_ms": self.own / n / 1e6,
            "total_ms": self.total / 1e6,
        }


class Clocked:
    """Spans of one thread: entering one pauses the own time of the span around it."""

    def __init__(self, monotonic: Callable[[], int]) -> None:
        self.now = monotonic
        self._stack: list[list[int]] = []  # start, time in nested spans

    def start(self) -> None:
        """Enter a span."""
        self._stack.append([self.now(), 0])

    def stop(self, histogram: Histogram) -> None:
        """Leave the innermost span and add it to `histogram`."""
        start, nested = self._stack.pop()
        duration = self.now() - start
        histogram.add(duration, duration - nested)
        if self._stack:
            self._stack[-1][1] += duration

    def stop_each(self, histogram: Histogram, ends: list[int]) -> None:
        """Leave the innermost span, which was many one after another: each ended [ns] where the next began."""
        start, nested = self._stack.pop()
        durations = np.diff(np.array([start, *ends]))
        duration = int(durations.sum())
        histogram.add_all(durations, duration - nested)
        if self._stack:
            self._stack[-1][1] += duration


class Span:
    """A reusable `with` block around `Clocked`."""

    __slots__ = ("_clocked", "_histogram")

    def __init__(self, clocked: Clocked, histogram: Histogram) -> None:
        self._clocked = clocked
        self._histogram = histogram

    def __enter__(self) -> None:
        self._clocked.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._clocked.stop(self._histogram)
