import numpy as np
import pytest

from knotwork.core.runtime.timing import Clocked, Histogram, Span


def test_percentiles_of_a_histogram_are_within_two_percent_of_the_sorted_durations():
    durations = np.random.default_rng(0).lognormal(12, 1.5, 20_000).astype(int)
    histogram = Histogram()
    for duration in durations.tolist():
        histogram.add(duration, duration)
    for share in (0.5, 0.95, 0.99):
        assert histogram.percentile(share) == pytest.approx(np.quantile(durations, share), rel=0.02)
    summary = histogram.summary()
    assert summary["mean_ms"] == pytest.approx(durations.mean() / 1e6)
    assert summary["max_ms"] == durations.max() / 1e6


def test_the_own_time_of_a_span_leaves_out_the_spans_inside_it():
    ticks = iter([0, 10, 25, 30, 32, 40])  # outer 0..40, inner 10..25 and 30..32
    clocked = Clocked(lambda: next(ticks))
    outer, inner = Histogram(), Histogram()
    with Span(clocked, outer):
        with Span(clocked, inner):
            pass
        with Span(clocked, inner):
            pass
    assert (outer.total, outer.own) == (40, 23)
    assert (inner.n, inner.total, inner.own) == (2, 17, 17)


def test_counts_are_those_of_a_logarithmic_histogram():
    durations = np.random.default_rng(1).lognormal(12, 2, 5_000).astype(int)
    histogram = Histogram()
    for duration in durations.tolist():
        histogram.add(duration, duration)
    counts = histogram.counts()
    edges = np.array([upper for upper, _ in counts]) * 1e6  # ns
    expected = [np.sum((durations + 1 >= edge * 2**-0.25 - 1e-6) & (durations + 1 < edge - 1e-6)) for edge in edges]
    assert [n for _, n in counts] == expected
    assert sum(n for _, n in counts) == 5_000
