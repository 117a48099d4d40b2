"""Cost of recording one scan-step: scan, odometry, prior, estimate and transform, lossless and views.

Beside it, in the same run, the `mcap` package's own writer given the same bytes.
"""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from mcap.writer import Writer

from knotwork.core import codec
from knotwork.core.messages import Message, Odometry, Pose, Scan, Transform
from knotwork.plugins.sinks.mcap import McapConfig
from knotwork.plugins.sinks.mcap.recorder import McapRecorder

STEPS, PASSES = 1000, 15


def steps(n: int, beams: int) -> list[list[tuple[str, Message]]]:
    rng = np.random.default_rng(0)
    base = rng.uniform(1, 8, beams)
    out = []
    for i in range(n):
        t = 10**18 + i * 200_000_000
        ranges = (base + 0.01 * rng.standard_normal(beams)).round(2).astype(np.float32)
        pose, p = rng.standard_normal(3), np.eye(3) * rng.uniform(0.1, 1)
        common = {"stamp": t, "time": t, "seq": 5 * i}
        out.append(
            [
                (
                    "log.scan",
                    Scan(
                        **common,
                        scan_id=i,
                        ranges=ranges,
                        angle_min=-1.57,
                        angle_increment=0.0175,
                        range_min=0.0,
                        range_max=80.0,
                    ),
                ),
                ("log.odometry", Odometry(**common, pose=pose, twist=pose)),
                ("prior.pose", Pose(**common, role="prior", pose=pose, covariance=p)),
                (
                    "localizer.pose",
                    Pose(
                        **common,
                        role="estimate",
                        pose=pose,
                        covariance=p,
                        scan_id=i,
                        quality=0.9,
                        scan_pose=pose,
                        scan_information=p,
                    ),
                ),
                ("prior.transform", Transform(**common, parent="map", child="odom", pose=pose)),
            ]
        )
    return out


def best(call: Callable[[], object]) -> float:
    """CPU time of one step [us]: the best of several passes, since the machine may be busy."""
    times = []
    for _ in range(PASSES):
        start = time.thread_time()
        call()
        times.append(time.thread_time() - start)
    return min(times) / STEPS * 1e6


def record(data: list[list[tuple[str, Message]]], **config: object) -> tuple[float, float]:
    """CPU time [us] and bytes of a step."""
    with tempfile.TemporaryDirectory() as folder:
        context = SimpleNamespace(
            name="mcap", config=McapConfig(**config), out=Path(folder), run={}, report=print, count=print
        )
        sink = McapRecorder(context)
        sink.open()
        cost = best(lambda: [sink.on_message(stream, message) for step in data for stream, message in step])
        sink.close()
        return cost, sink.path.stat().st_size / STEPS / PASSES


def peer(data: list[list[tuple[str, Message]]]) -> float:
    """CPU time [us] of the `mcap` package's writer for the lossless bytes of a step, encoding not counted."""
    blobs = [codec.encode(message) for step in data for _, message in step]
    with tempfile.TemporaryDirectory() as folder:
        writer = Writer(f"{folder}/peer.mcap", chunk_size=65536)
        writer.start()
        channel = writer.register_channel("/x", "msgpack", 0)
        cost = best(lambda: [writer.add_message(channel, 1, blob, 1) for blob in blobs])
        writer.finish()
        return cost


def main() -> None:
    for beams in (180, 360):
        data = steps(STEPS, beams)
        for views_on in (False, True):
            for compression in ("zstd", "lz4", "none"):
                cost, size = record(data, compression=compression, views=views_on)
                print(f"{beams} beams, views {views_on!s:5}, {compression:4}: {cost:5.1f} us a step, {size:5.0f} B")
        print(f"{beams} beams, mcap.Writer alone, lossless bytes only: {peer(data):5.1f} us a step")


if __name__ == "__main__":
    main()
