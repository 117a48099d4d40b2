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


def test_spans_one_after_another_count_as_if_each_had_been_timed():
    ends = [15, 15, 40, 1_000_040]
    ticks = iter([0, 10, 20, 28, 1_000_050])
    clocked = Clocked(lambda: next(ticks))
    outer, many, inner = Histogram(), Histogram(), Histogram()
    clocked.start()
    clocked.start()
    clocked.start()
    clocked.stop(inner)  # 8 ns within the third
    clocked.stop_each(many, ends)
    clocked.stop(outer)
    single = Histogram()
    for duration, own in ((5, 5), (0, 0), (25, 17), (1_000_000, 1_000_000)):
        single.add(duration, own)
    assert many.summary() == single.summary()
    assert many.counts() == single.counts()
    assert (outer.total, outer.own) == (1_000_050, 1_000_050 - 1_000_030)


def test_no_span_at_all_counts_as_none():
    clocked, histogram = Clocked(lambda: 7), Histogram()
    clocked.start()
    clocked.stop_each(histogram, [])
    assert (histogram.n, histogram.total, histogram.maximum) == (0, 0, 0)
