"""What a run reports of itself: per node times, drops and counters; memory; wall time."""

import resource
from typing import Any

from knotwork.core import clock
from knotwork.core.runtime.assembly import Assembly


def measure(assembly: Assembly, begun: int, first_event: int, *, histograms: bool = False) -> dict[str, Any]:
    """Return the figures so far; `begun` (the process) and `first_event` are monotonic [ns], 0 for not yet.

    Keys: `startup_s` (to the first event), `wall_s` (since it), `peak_rss_mb`, `nodes` (per node and
    per span `node.name`: n, mean_ms, p50_ms, p95_ms, p99_ms, max_ms, self_mean_ms (nested spans taken
    out), total_ms, drops) and `counters` (per node); with `histograms`, those under that key, per node and
    span (see `Histogram.counts`).
    """
    nodes: dict[str, Any] = {}
    counters: dict[str, Any] = {}
    for name, context in assembly.contexts.items():
        nodes |= {key: h.summary() for key, h in list(context.histograms.items()) if h.n}
        drops = sum(outlet.channel.drops for outlet in context.outlets.values())
        figures: dict[str, Any] = dict(context.counters)
        worker = assembly.workers.get(name)
        if worker is not None:
            drops += worker.drops
            figures |= {"backlog": worker.backlog, "backlog_max": worker.backlog_max, "failures": worker.failures}
        nodes.setdefault(name, {"n": 0})["drops"] = drops
        node = assembly.nodes.get(name)
        counters[name] = figures | (node.statistics() if node is not None else {})
    now = clock.monotonic()
    more: dict[str, Any] = {}
    if histograms:
        found = {key: h for context in assembly.contexts.values() for key, h in list(context.histograms.items())}
        more = {"histograms": {key: h.counts() for key, h in found.items() if h.n}}
    return more | {
        "startup_s": ((first_event or now) - begun) / 1e9,
        "wall_s": (now - (first_event or now)) / 1e9,
        "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "nodes": nodes,
        "counters": {name: figures for name, figures in counters.items() if figures},
    }
