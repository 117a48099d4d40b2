import gc
import threading
import time
from pathlib import Path

import pytest
import toy_impl

from knotwork.core import config, graph
from knotwork.core.errors import NodeError
from knotwork.core.registry import Registry
from knotwork.core.runtime import Result, Run


@pytest.fixture
def run(tmp_path):
    """Run a pipeline of toy plugins given as YAML nodes; returns its result and what the sink kept."""

    def execute(nodes: str, *, prepare=lambda run: None, **options) -> tuple[Result, list]:
        file = tmp_path / "pipeline.yaml"
        file.write_text(f"pipeline: toy\nnodes:\n{nodes}")
        registry = Registry(["toy_nodes"], third_parties=False)
        pipeline = config.load(file, registry)
        execution = Run(pipeline, graph.build(pipeline), registry, Path(tmp_path / "out"), **options)
        prepare(execution)
        return execution.execute(), toy_impl.Keeper.kept

    return execute


LOG = "  log: {plugin: toy-log, stamps: [5, 7, 3, 9]}\n"
KEEP = "  keep: {plugin: toy-keeper}\n"


def named(kept, stream):
    return [m for s, m in kept if s == stream]


def test_time_is_the_running_maximum_of_the_stamps_and_seq_counts_dispatches(run):
    result, kept = run(LOG + "  echo: {plugin: toy-echo}\n" + KEEP)
    assert result.exit_code == 0
    twists, poses = named(kept, "log.out"), named(kept, "echo.pose")
    assert [m.stamp for m in twists] == [5, 7, 3, 9]
    assert [m.time for m in twists] == [5, 7, 7, 9]
    assert [m.time for m in poses] == [5, 7, 7, 9]
    # run to completion: each pose directly follows the twist it comes from
    assert [m.seq for m in twists] == [0, 2, 4, 6]
    assert [m.seq for m in poses] == [1, 3, 5, 7]


def test_collections_during_a_run_leave_out_what_was_there_before(run):
    frozen = []
    gc.unfreeze()
    run(LOG + KEEP, prepare=lambda each: each.tap(lambda stream, message: frozen.append(gc.get_freeze_count())))
    assert min(frozen) > 10_000  # the modules' objects: to walk them takes a tenth of a second, all threads waiting
    assert gc.get_freeze_count() == 0


def test_two_logs_are_merged_by_time_then_order_in_the_file(run):
    nodes = "  b: {plugin: toy-log, stamps: [1, 4, 4]}\n  a: {plugin: toy-log, stamps: [0, 4, 5]}\n"
    _, kept = run(nodes + KEEP)
    order = [(s, m.stamp) for s, m in kept if s in ("a.out", "b.out")]
    assert order == [("a.out", 0), ("b.out", 1), ("b.out", 4), ("b.out", 4), ("a.out", 4), ("a.out", 5)]


def test_a_command_given_at_step_k_acts_over_the_interval_to_step_k_plus_1(run):
    result, kept = run("  sim: {plugin: toy-sim}\n  policy: {plugin: toy-policy}\n" + KEEP)
    assert result.statistics["clock"] == "sim"
    x = [m.pose[0] for m in named(kept, "sim.truth")]
    expected = [0.0]
    for _ in range(9):
        expected.append(expected[-1] + expected[-1] + 1.0)
    assert x == expected


def test_timers_fire_in_order_with_the_events(run):
    nodes = "  log: {plugin: toy-log, stamps: [0, 2500000000, 4000000000]}\n  timer: {plugin: toy-timer, period: 1.0}\n"
    _, kept = run(nodes + KEEP)
    order = [(s, m.time / 1e9) for s, m in kept if s in ("log.out", "timer.twist")]
    # a timer that is due at the time of an event fires before it
    assert order == [
        ("log.out", 0.0), ("timer.twist", 1.0), ("timer.twist", 2.0), ("log.out", 2.5),
        ("timer.twist", 3.0), ("timer.twist", 4.0), ("log.out", 4.0),
    ]  # fmt: skip


@pytest.mark.parametrize("used_first", [True, False])
def test_a_node_finishes_after_those_that_use_it(run, used_first):
    used, users = "  used: {plugin: toy-prior}\n", "  one: {plugin: toy-user}\n  two: {plugin: toy-user}\n"
    _, kept = run(LOG + (used + users if used_first else users + used) + KEEP)
    texts = [m.text for m in named(kept, "runtime.events")]
    assert texts[-3:] == ["last use of used", "last use of used", "used finishes"]


def test_an_estimator_that_raises_ends_the_run_with_its_name_and_cause(run):
    result, kept = run(LOG + "  bad: {plugin: toy-broken, text: my cause}\n" + KEEP)
    assert result.exit_code == 1
    assert isinstance(result.failure, NodeError)
    assert result.failure.node == "bad"
    assert "my cause" in str(result.failure)
    assert "toy_impl.py" in result.trace
    # the first event, whose handling failed, is all that was accepted, and the sink was closed in order
    assert toy_impl.Keeper.calls == ["open", "finish", "close"]
    assert kept[-1][0] == "runtime.statistics"


def test_a_message_of_another_type_than_declared_is_an_error(run):
    result, _ = run(LOG + "  liar: {plugin: toy-liar}\n")
    assert "gave a twist on 'scan', declared as scan" in str(result.failure)


def test_a_sink_that_raises_is_reported_and_given_up_while_the_run_goes_on(run):
    lines = []
    stamps = ", ".join(str(i) for i in range(50))
    result, kept = run(
        f"  log: {{plugin: toy-log, stamps: [{stamps}]}}\n  bad: {{plugin: toy-bad-sink}}\n" + KEEP,
        console=lambda node, level, text: lines.append((node, level, text)),
    )
    assert result.exit_code == 1
    assert result.failure is None
    assert len(named(kept, "log.out")) == 50
    assert ("bad", "error", "OSError: [Errno 28] No space left on device") in lines
    assert result.statistics["counters"]["bad"]["failures"] == 10
    assert result.statistics["nodes"]["bad"]["drops"] == 41  # 40 twists and the last statistics


def test_a_run_stops_when_asked_and_closes_in_order(run):
    def stop_at_third(execution):
        execution.tap(lambda stream, message: execution.stop("test") if message.stamp == 3 else None)

    result, kept = run(LOG + KEEP, prepare=stop_at_third)
    assert result.exit_code == 0
    assert result.statistics["stopped_by"] == "test"
    assert [m.stamp for m in named(kept, "log.out")] == [5, 7, 3]
    assert toy_impl.Keeper.calls == ["open", "finish", "close"]


def test_a_device_pushes_from_its_thread_and_all_arrive_in_order(run, monkeypatch):
    def prepare(execution):
        def when_last_arrived(stream, message):
            if stream == "device.out" and message.vx == 19.0:
                execution.stop("done")

        execution.tap(when_last_arrived)

    result, kept = run("  device: {plugin: toy-device}\n" + KEEP, prepare=prepare)
    assert result.statistics["clock"] == "real"
    assert [m.vx for m in named(kept, "device.out")] == [float(i) for i in range(20)]


def test_what_a_device_says_from_its_thread_is_in_the_log_to_its_last_word(run):
    def stop_at_the_last(execution):
        execution.tap(lambda stream, message: execution.stop("done") if message.stamp == 20 else None)

    result, kept = run("  device: {plugin: toy-device}\n" + KEEP, prepare=stop_at_the_last)
    assert [(e.node, e.level, e.text) for e in named(kept, "runtime.events")] == [
        ("device", "info", "begun"),
        ("device", "warning", "ended"),
    ]
    # what is said before anything was measured does not set the run's clock
    assert [m.time for m in named(kept, "device.out")] == list(range(1, 21))
    assert result.statistics["nodes"]["device"]["drops"] == 0


def test_a_node_sees_the_nodes_it_uses(run):
    lines = []
    nodes = "  user: {plugin: toy-user}\n  late: {plugin: toy-prior}\n"
    run(LOG + nodes, console=lambda node, level, text: lines.append(text))
    assert lines[:4] == ["uses late"] * 4


def test_reports_of_a_node_are_events_in_the_log(run):
    nodes = "  user: {plugin: toy-user}\n  late: {plugin: toy-prior}\n"
    _, kept = run(LOG + nodes + KEEP)
    events = named(kept, "runtime.events")
    assert [(e.node, e.level, e.text) for e in events[:4]] == [("user", "info", "uses late")] * 4


def test_statistics_count_handlers_spans_and_counters(run):
    result, kept = run(LOG + "  echo: {plugin: toy-echo}\n" + KEEP)
    nodes = result.statistics["nodes"]
    assert nodes["echo"]["n"] == nodes["echo.inner"]["n"] == 4
    assert nodes["echo"]["self_mean_ms"] <= nodes["echo"]["mean_ms"] - nodes["echo.inner"]["mean_ms"] + 1e-9
    assert result.statistics["counters"]["echo"] == {"seen": 4}
    last = kept[-1][1]
    assert last.final
    assert last.data["nodes"]["echo"]["n"] == 4


def test_two_runs_give_the_same_messages(run):
    nodes = "  sim: {plugin: toy-sim}\n  policy: {plugin: toy-policy}\n" + KEEP
    seen = [[(s, m.seq, m.time, repr(m)) for s, m in run(nodes)[1] if s != "runtime.statistics"] for _ in range(2)]
    assert seen[0] == seen[1]


def test_a_log_at_rate_one_takes_at_least_as_long_as_it_lasted(run):
    begun = time.monotonic()
    run("  log: {plugin: toy-log, stamps: [0, 150000000]}\n", rate=1.0)
    assert time.monotonic() - begun >= 0.15


def test_logged_messages_keep_their_time_and_number_and_are_merged_by_them(run, monkeypatch):
    """Two sources of one log give its messages as they once arrived: a late one stays late."""
    logged = {"a": [(5, 10, 3), (9, 12, 8)], "b": [(10, 10, 2), (7, 12, 9), (20, 20, 11)]}  # stamp, time, seq

    class Logged(toy_impl.Log):
        def events(self):
            for stamp, at, seq in logged[self.context.name]:
                yield "out", toy_impl.twist(stamp).sealed(at, seq)

    monkeypatch.setattr(toy_impl, "Log", Logged)
    nodes = "  a: {plugin: toy-log}\n  b: {plugin: toy-log}\n  timer: {plugin: toy-timer, period: 4.0e-9}\n"
    _, kept = run(nodes + KEEP)
    order = [(s, m.stamp, m.time, m.seq) for s, m in kept if s != "runtime.statistics"]
    assert order == [
        ("b.out", 10, 10, 2), ("a.out", 5, 10, 3), ("a.out", 9, 12, 8), ("b.out", 7, 12, 9),
        ("timer.twist", 14, 14, 10), ("timer.twist", 18, 18, 11), ("b.out", 20, 20, 12),
    ]  # fmt: skip


def test_time_alone_tells_which_timers_came_before_a_message_of_a_device(run, monkeypatch):
    """A device's stamp ahead of the clock: the timers due by then have fired, or a replay could not know."""

    class Ahead(toy_impl.Device):
        def work(self):
            for stamp in (10**9, 5 * 10**9, 3 * 10**9):
                self.context.emit("out", toy_impl.twist(stamp))
            assert enough.wait(10)
            type(self).done()

    monkeypatch.setattr(toy_impl, "Device", Ahead)
    enough = threading.Event()
    executions = []

    def prepare(execution):
        executions.append(execution)
        execution.tap(lambda stream, message: enough.set() if message.stamp == 3 * 10**9 else None)

    monkeypatch.setattr(Ahead, "done", staticmethod(lambda: executions[0].stop("done")))
    nodes = "  device: {plugin: toy-device}\n  timer: {plugin: toy-timer, period: 1.5}\n"
    _, kept = run(nodes + KEEP, prepare=prepare)
    order = [(s, m.time / 1e9) for s, m in kept if s in ("device.out", "timer.twist")]
    assert order[:4] == [("device.out", 1.0), ("timer.twist", 2.5), ("timer.twist", 4.0), ("device.out", 5.0)]
