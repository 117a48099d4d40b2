"""A sink that asks to be woken for each message is."""

from threading import Event
from types import SimpleNamespace

from knotwork.core.contracts import Sink
from knotwork.core.messages import Odometry
from knotwork.core.runtime import sink_worker
from knotwork.core.runtime.sink_worker import SinkWorker, monotonic_clocked
from knotwork.core.runtime.timing import Histogram


def test_a_prompt_sink_does_not_wait_for_the_next_look(monkeypatch):
    monkeypatch.setattr(sink_worker, "_LOOK_EVERY", 600.0)
    came = Event()

    class Prompt(Sink):
        prompt = True

        def on_message(self, stream, message):
            came.set()

    sink = Prompt(SimpleNamespace(name="s"))
    worker = SinkWorker(sink, 10, "block", monotonic_clocked(), Histogram(), lambda error, given_up: None)
    worker.start()
    message = Odometry(stamp=0, pose=None)
    for _ in range(3):
        worker.put("a.b", message, 0)
        assert came.wait(60)
        came.clear()
    assert worker.finish(10)
