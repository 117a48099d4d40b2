"""What ten viewers of the live page cost the estimators: latency of the localiser with and without them.

A simulated TurtleBot3 maps an apartment at five times real time; runs with and without viewers take turns in
one process, the viewers are another process and read everything. Without a page at all stands beside it. CPU is
that of the run's process, start-up included: on a busy machine it is the figure to trust.

    python bench/live_view.py [TURNS]
"""

import multiprocessing
import socket
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from knotwork.core import config, graph
from knotwork.core.registry import Registry
from knotwork.core.runtime import Run

VIEWERS = 10
PIPELINE = """\
pipeline: viewed
nodes:
  sim: {plugin: sim2d, world: apartment, duration: 40}
  prior: {plugin: ekf}
  map: {plugin: spline-surface, resolution: [0.30, 0.125, 0.05, 0.03], hit: 5, publish: 5}
  localizer: {plugin: gauss-newton, uses: {map: map, prior: prior}}
  drive: {plugin: follow-path, world: apartment, path: tour}
"""


def look(port, count, over, answer):
    """The viewers: connect as long as there is a server, read and forget."""
    read = 0
    while not over.is_set():
        held = []
        while len(held) < count and not over.is_set():
            try:
                raw = socket.create_connection(("127.0.0.1", port), timeout=0.5)
                raw.sendall(f"GET /stream HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
                raw.settimeout(0.5)
                held.append(raw)
            except OSError:
                over.wait(0.2)
        alive = True
        while alive and not over.is_set():
            for raw in held:
                try:
                    data = raw.recv(1 << 16)
                    read += len(data)
                    alive &= bool(data)
                except TimeoutError:
                    continue
                except OSError:
                    alive = False
        for raw in held:
            raw.close()
    answer.put(read)


def once(folder, port):
    live = f"  live: {{plugin: live, port: {port}}}\n" if port else ""
    path = Path(folder) / "viewed.yaml"
    path.write_text(PIPELINE + live)
    registry = Registry(third_parties=False)
    pipeline = config.load(str(path), registry)
    run = Run(pipeline, graph.build(pipeline), registry, Path(folder) / "out", rate=5.0)
    result = run.execute()
    assert result.exit_code == 0, result.failure
    return result.statistics


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]


def main():
    turns = int(sys.argv[1]) if len(sys.argv) > 1 else 4
    process = multiprocessing.get_context("spawn")
    found = {"no page": [], "page, no viewer": [], f"page, {VIEWERS} viewers": []}
    with tempfile.TemporaryDirectory() as folder:
        once(folder, 0)  # compiles
        for _ in range(turns):
            for name, values in found.items():
                port = 0 if name == "no page" else free_port()
                child = None
                if str(VIEWERS) in name:
                    over, answer = process.Event(), process.Queue()
                    child = process.Process(target=look, args=(port, VIEWERS, over, answer))
                    child.start()
                before = time.process_time()
                statistics = once(folder, port)
                used = time.process_time() - before
                if child is not None:
                    over.set()
                    read = answer.get()
                    child.join()
                    assert statistics["counters"]["live"]["viewers_max"] == VIEWERS
                values.append([statistics["nodes"]["localizer"][key] for key in ("p50_ms", "p95_ms")] + [used])
    base = np.median(np.array(found["page, no viewer"]), axis=0)
    for name, values in found.items():
        p50, p95, used = np.median(np.array(values), axis=0)
        ratios = f"({p50 / base[0]:.2f} x, {p95 / base[1]:.2f} x)"
        print(f"{name:20} p50 {p50:6.2f} ms  p95 {p95:6.2f} ms  {ratios}  CPU {used:5.2f} s of a run")
    print(f"each viewer read {read / VIEWERS / 8 / 1e3:.0f} kB/s")


if __name__ == "__main__":
    main()
