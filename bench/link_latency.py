"""How long a message is on its way from machine to machine: two processes on loopback, zenoh-out to zenoh-in.

50 Hz odometry and 5 Hz scans of 360 beams, through the runtime on both sides; the latency is from the message's
emission in one process to its handling in the other. Beside it, in the same run, a bare TCP connection with the
same bytes.

    python bench/link_latency.py [SECONDS]
"""

import multiprocessing
import socket
import sys
import threading
import time

import numpy as np

from knotwork.core.codec import encode
from knotwork.core.messages import Odometry, Scan
from knotwork.core.runtime.sink_worker import SinkWorker, monotonic_clocked
from knotwork.core.runtime.timing import Histogram
from knotwork.plugins.drivers.zenoh_in import MANIFEST as IN
from knotwork.plugins.drivers.zenoh_in.driver import ZenohIn
from knotwork.plugins.sinks.zenoh_out import MANIFEST as OUT
from knotwork.plugins.sinks.zenoh_out.sink import ZenohOut

STREAMS = {
    "odometry": {"stream": "base.odometry", "message": "odometry"},
    "scan": {"stream": "lidar.scan", "message": "scan"},
}


class Plain:
    """As much of a context as the two ends need."""

    playback = None

    def __init__(self, manifest, config, take=None):
        self.name = manifest.name
        self.config = manifest.config.model_validate(config)
        self.emit = take

    def now(self):
        return 0

    def report(self, level, text):
        print(f"  {level}: {text}")

    def count(self, name, by=1):
        pass


def message(number):
    stamp = time.monotonic_ns()
    if number % 10:
        return "base.odometry", Odometry(stamp=stamp, pose=np.zeros(3), twist=np.zeros(3))
    ranges = np.ones(360, np.float32)
    return "lidar.scan", Scan(
        stamp=stamp, scan_id=0, ranges=ranges, angle_min=0, angle_increment=0.01, range_min=0, range_max=9
    )


def receive(zenoh_port, tcp_port, over, answer):
    """The other machine."""
    ages = []
    node = ZenohIn(
        Plain(
            IN,
            {"link": "bench", "connect": [f"tcp/127.0.0.1:{zenoh_port}"], "streams": STREAMS},
            lambda port, m: ages.append(time.monotonic_ns() - m.stamp) if port != "link" else None,
        )
    )
    node.open()
    node.start()
    bare = []

    def listen():
        with socket.create_connection(("127.0.0.1", tcp_port)) as raw:
            raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            file = raw.makefile("rb")
            while head := file.read(12):
                sent, size = int.from_bytes(head[:8], "little"), int.from_bytes(head[8:], "little")
                file.read(size)
                bare.append(time.monotonic_ns() - sent)

    thread = threading.Thread(target=listen, daemon=True)
    thread.start()
    over.wait()
    node.stop()
    node.close()
    answer.put((ages, bare))


def main():
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    with socket.create_server(("127.0.0.1", 0)) as probe:
        zenoh_port = probe.getsockname()[1]
    tcp = socket.create_server(("127.0.0.1", 0))
    process = multiprocessing.get_context("spawn")
    answer, over = process.Queue(), process.Event()
    node = ZenohOut(Plain(OUT, {"link": "bench", "listen": [f"tcp/127.0.0.1:{zenoh_port}"]}))
    node.open()
    worker = SinkWorker(node, 10_000, "drop-oldest", monotonic_clocked(), Histogram(), lambda error, given_up: None)
    worker.start()
    child = process.Process(target=receive, args=(zenoh_port, tcp.getsockname()[1], over, answer))
    child.start()
    raw, _ = tcp.accept()
    raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    time.sleep(1.5)
    for number in range(round(seconds * 55)):
        stream, each = message(number)
        worker.put(stream, each.sealed(0, number))
        data = encode(each)
        raw.sendall(time.monotonic_ns().to_bytes(8, "little") + len(data).to_bytes(4, "little") + data)
        time.sleep(1 / 55)
    time.sleep(1)
    over.set()
    ages, bare = answer.get(timeout=30)
    child.join()
    raw.close()
    node.close()
    for name, values in (("zenoh-out to zenoh-in", ages), ("bare TCP", bare)):
        p50, p95, p99 = np.percentile(np.array(values) / 1e6, (50, 95, 99))
        print(f"{name:22} n {len(values):5}  p50 {p50:6.2f} ms  p95 {p95:6.2f} ms  p99 {p99:6.2f} ms")


if __name__ == "__main__":
    main()
