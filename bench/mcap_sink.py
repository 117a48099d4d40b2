"""Cost of recording one scan-step: scan, odometry, prior, estimate and transform, lossless and views.

Beside it, in the same run, the `mcap` package's own writer given the same bytes.
"""

import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from mcap.writer import Writer

from knotwork.core import codec
from knotwork.core.messages import Message, Odometry, Pose, Scan, Transform
from knotwork.core.views import views
from knotwork.plugins.sinks.mcap import McapConfig
from knotwork.plugins.sinks.mcap.recorder import McapRecorder


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


def main() -> None:
    n = 10_000
    for beams in (180, 360):
        data = steps(n, beams)
        for views_on in (False, True):
            for compression in ("zstd", "lz4", "none"):
                with tempfile.TemporaryDirectory() as folder:
                    config = McapConfig(compression=compression, views=views_on)
                    context = SimpleNamespace(
                        name="mcap",
                        config=config,
                        out=Path(folder),
                        run={},
                        report=sys.stderr.write,
                        count=print,
                    )
                    sink = McapRecorder(context)
                    sink.open()
                    start, cpu = time.perf_counter(), time.thread_time()
                    for step in data:
                        for stream, message in step:
                            sink.on_message(stream, message)
                    wall, cpu = time.perf_counter() - start, time.thread_time() - cpu
                    sink.close()
                    size = sink.path.stat().st_size
                print(
                    f"{beams} beams, views {views_on!s:5}, {compression:4}: {wall / n * 1e6:6.1f} us a step "
                    f"({cpu / n * 1e6:.1f} CPU), {size / n:6.0f} B a step"
                )
        for name, call in (
            ("encode", lambda m: codec.encode(m)),
            ("views", lambda m: [view.render(m) for view in views(m.type_name)]),
        ):
            for index, (stream, _) in enumerate(data[0]):
                start = time.perf_counter()
                for step in data:
                    call(step[index][1])
                print(f"  {name} {stream}: {(time.perf_counter() - start) / n * 1e6:.1f} us")
        with tempfile.TemporaryDirectory() as folder:
            writer = Writer(f"{folder}/peer.mcap", chunk_size=65536)
            writer.start()
            channel = writer.register_channel("/x", "msgpack", 0)
            blobs = [codec.encode(message) for step in data for _, message in step]
            start = time.perf_counter()
            for blob in blobs:
                writer.add_message(channel, 1, blob, 1)
            each = (time.perf_counter() - start) / n * 1e6
            print(f"  peer: mcap.Writer, lossless only, encoding not counted: {each:.1f} us a step")
            writer.finish()


if __name__ == "__main__":
    main()
