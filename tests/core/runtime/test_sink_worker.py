"""The queue before a sink: bounded in messages and in bytes, drops told and counted, blocking in replay."""

import threading
from types import SimpleNamespace

import pytest

from knotwork.core.contracts import Sink
from knotwork.core.messages import Image, Twist
from knotwork.core.runtime import sink_worker
from knotwork.core.runtime.sink_worker import SinkWorker, monotonic_clocked
from knotwork.core.runtime.timing import Histogram


class Slow(Sink):
    """Takes nothing before it is let."""

    def __init__(self):
        super().__init__(SimpleNamespace(name="slow"))
        self.let = threading.Event()
        self.busy = threading.Event()
        self.taken = []

    def on_message(self, stream, message):
        self.busy.set()
        self.let.wait(10)
        self.taken.append(message.stamp)


def image(stamp):
    return Image(stamp=stamp, data=bytes(1000), encoding="mono8", width=10, height=100)


@pytest.fixture
def start(monkeypatch):
    monkeypatch.setattr(sink_worker, "_BYTES", 5000)
    workers = []

    def make(sink, size, policy, dropping=lambda: None):
        failed = []
        worker = SinkWorker(
            sink, size, policy, monotonic_clocked(), Histogram(), lambda *it: failed.append(it), dropping
        )  # fmt: skip
        worker.start()
        workers.append((worker, sink, failed))
        return worker

    yield make
    for worker, sink, failed in workers:
        sink.let.set()
        assert worker.finish(10)
        assert failed == []


def test_bytes_are_bounded_and_the_first_drop_is_told(start):
    sink, told = Slow(), []
    worker = start(sink, 1000, "drop-oldest", lambda: told.append(worker.drops))
    worker.put("camera.image", image(0), 1000)
    assert sink.busy.wait(10)  # it has the first in its hand, which still counts
    for stamp in range(1, 50):
        worker.put("camera.image", image(stamp), 1000)
    assert worker.backlog == 4
    assert worker.drops == 45
    assert told == [1]
    sink.let.set()
    assert worker.finish(10)
    assert sink.taken == [0, 46, 47, 48, 49]


def test_small_messages_are_bounded_by_their_number(start):
    sink = Slow()
    worker = start(sink, 10, "drop-oldest")
    worker.put("a.b", Twist(stamp=0, vx=0.0), 0)
    assert sink.busy.wait(10)
    for stamp in range(1, 100):
        worker.put("a.b", Twist(stamp=stamp, vx=0.0), 0)
    assert (worker.backlog, worker.drops) == (10, 89)


def test_in_replay_the_run_waits_and_nothing_is_lost(start):
    sink = Slow()
    worker = start(sink, 1000, "block")

    def give():
        for stamp in range(50):
            worker.put("camera.image", image(stamp), 1000)

    giver = threading.Thread(target=give)
    giver.start()
    giver.join(0.3)
    assert giver.is_alive()
    assert worker.backlog <= 5
    sink.let.set()
    giver.join(10)
    assert worker.finish(10)
    assert sink.taken == list(range(50))
    assert worker.drops == 0


def test_a_message_larger_than_the_bound_passes(start):
    sink = Slow()
    sink.let.set()
    worker = start(sink, 1000, "block")
    worker.put("camera.image", Image(stamp=1, data=bytes(9000), encoding="mono8", width=90, height=100), 9000)
    assert worker.finish(10)
    assert sink.taken == [1]


class Picky(Sink):
    """Takes all that waits at once, and fails at some."""

    def __init__(self, bad):
        super().__init__(SimpleNamespace(name="picky"))
        self.bad = bad
        self.taken = []

    def on_message(self, stream, message):
        raise AssertionError("it is given all that wait")

    def on_messages(self, messages):
        for _, message in messages:
            if message.stamp in self.bad:
                raise ValueError(f"not {message.stamp}")
            self.taken.append(message.stamp)


@pytest.mark.parametrize(
    ("bad", "failures", "drops"),
    [
        ({0, 3, 4, 19}, 4, 0),
        (set(range(5, 14)) | {15}, 10, 0),  # nine in a row, a good one, one more
        (set(range(5, 15)), 10, 5),  # ten in a row: given up, the last five are counted
    ],
)
def test_a_failure_costs_its_own_message(bad, failures, drops):
    told, histogram = [], Histogram()
    sink = Picky(bad)
    worker = SinkWorker(sink, 100, "block", monotonic_clocked(), histogram, lambda *it: told.append(it))
    for stamp in range(20):
        worker.put("a.b", Twist(stamp=stamp, vx=0.0), 0)
    worker.start()
    assert worker.finish(10)
    assert sink.taken == [stamp for stamp in range(20 - drops) if stamp not in bad]
    assert [str(error) for error, _ in told] == [f"not {stamp}" for stamp in sorted(bad)]
    assert (worker.failures, worker.drops) == (failures, drops)
    assert [given_up for _, given_up in told] == [False] * (failures - 1) + [drops > 0]
    assert histogram.n == 20
