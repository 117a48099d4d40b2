"""A whole pipeline on the emulated robot: accuracy, drops, latency, CPU, memory.

    python bench/emulated_robot.py [--duration S] [--dirty] [--lidar lds02] [--base dynamixel] [--every S]

Runs `knotwork emulate` and `knotwork run` as two processes. The error is that of each scan's pose against the
true path at the scan's stamp, the first true pose being the origin of the map; nothing is aligned. `--dirty`
loses 1 % of the lidar's bytes, flips 0.1 % of its bits and loses 0.1 % of the base's bytes. `--every` prints
memory and the newest pose's age, which grows if stamps drift, while it runs: for a soak.

The emulator is given precedence where the system allows it: the electronics of a robot do not become slow with
the computer.
"""

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from knotwork.core.clock import epoch
from knotwork.core.evaluation.tum import StampedPoses, read_tum

_DIRTY = ["--drop-bytes", "lidar=0.01", "--flip-bits", "lidar=0.001", "--drop-bytes", "base=0.001"]
_KNOTWORK = [sys.executable, "-c", "import sys; from knotwork.core.cli.main import main; sys.exit(main())"]
_PRECEDENCE = -10  # nice value of the emulator
_START = 300.0  # s that the run may take to its first pose: compiling, loading, calibrating the gyro


def errors(estimate: StampedPoses, truth: StampedPoses) -> np.ndarray:
    """Distance [m] of each estimated position from the true path at its stamp."""
    inside = (estimate.stamps >= truth.stamps[0]) & (estimate.stamps <= truth.stamps[-1])
    t = (estimate.stamps[inside] - truth.stamps[0]) * 1e-9
    known = (truth.stamps - truth.stamps[0]) * 1e-9
    x, y = (np.interp(t, known, truth.poses[:, i]) for i in (0, 1))
    return np.asarray(np.hypot(estimate.poses[inside, 0] - x, estimate.poses[inside, 1] - y))


def run(arguments: argparse.Namespace, folder: Path) -> dict[str, object]:
    emulate = [
        *_KNOTWORK, "emulate", "turtlebot3",
        "--world", "apartment", "--lidar", arguments.lidar, "--base", arguments.base, "--seed", str(arguments.seed),
        "--truth", str(folder / "truth.tum"), "--events", str(folder / "events.jsonl"),
        *(_DIRTY if arguments.dirty else []),
    ]  # fmt: skip
    robot = subprocess.Popen(emulate, stdout=subprocess.PIPE, text=True, start_new_session=True)
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, robot.pid, _PRECEDENCE)
        Path(f"/proc/{robot.pid}/autogroup").write_text(str(_PRECEDENCE))
    out = folder / "out"
    pipeline: subprocess.Popen[bytes] | None = None
    try:
        assert robot.stdout is not None
        paths = dict(robot.stdout.readline().strip().split(": ", 1) for _ in range(2))
        overrides = [f"vars.lidar={paths['lidar']}", f"vars.base={paths['base']}", "nodes.drive.loop=true"]
        overrides += [f"nodes.lidar.model={arguments.lidar}"]
        # On a busy machine either process may pause for longer than a lidar may be silent.
        overrides += ["nodes.base.safety.rearm=auto"]
        if arguments.base == "dynamixel":
            overrides += ["nodes.base.plugin=dynamixel-wheels"]
        command = [
            *_KNOTWORK, "run", "configs:turtlebot3-burger-path.yaml", "--out", str(out), "--quiet",
            *(part for o in [*overrides, *arguments.set] for part in ("--set", o)),
        ]  # fmt: skip
        pipeline = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        _wait(pipeline, arguments, folder)
        if pipeline.poll() is not None:
            raise SystemExit(f"the run has ended by itself, exit code {pipeline.returncode}")
        ended = epoch()
        pipeline.send_signal(signal.SIGINT)
        _, status, used = os.wait4(pipeline.pid, 0)
        pipeline.returncode = os.waitstatus_to_exitcode(status)
    finally:
        if pipeline is not None and pipeline.returncode is None:
            pipeline.kill()
        robot.send_signal(signal.SIGTERM)
        robot.wait(10.0)
    return figures(folder, out, used, pipeline.returncode, ended)


def _wait(pipeline: "subprocess.Popen[bytes]", arguments: argparse.Namespace, folder: Path) -> None:
    path = folder / "out" / "trajectory.online.tum"
    started = time.monotonic()
    while not path.exists() and pipeline.poll() is None:
        if time.monotonic() - started > _START:
            raise SystemExit(f"no pose within {_START:g} s")
        time.sleep(0.1)
    started = shown = time.monotonic()
    while time.monotonic() - started < arguments.duration and pipeline.poll() is None:
        time.sleep(0.5)
        if arguments.every and time.monotonic() - shown > arguments.every:
            shown = time.monotonic()
            status = Path(f"/proc/{pipeline.pid}/status").read_text()
            rss = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
            age = (epoch() - _newest(path)) * 1e-9
            print(f"{shown - started:7.0f} s  {rss / 1024:.1f} MB  newest pose {age:.2f} s old", flush=True)


def _newest(path: Path) -> int:
    """Return the stamp [ns] of the last line of a TUM file."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - 200, 0))
        whole, fraction = file.read().splitlines()[-1].split()[0].decode().split(".")
    return int(whole) * 1_000_000_000 + int(fraction.ljust(9, "0"))


def figures(folder: Path, out: Path, used: resource.struct_rusage, code: int, ended: int) -> dict[str, object]:
    summary = json.loads((out / "summary.json").read_text())
    estimate = read_tum(out / "trajectory.online.tum")
    distance = errors(estimate, read_tum(folder / "truth.tum"))
    counters, nodes = summary["counters"], summary["nodes"]
    return {
        "exit code": code,
        "driven [s]": round(summary["wall_s"], 1),
        "scans": int(counters["lidar"]["scans"]),
        "poses": len(distance),
        "position error [cm RMS]": round(100 * float(np.sqrt(np.mean(distance**2))), 2),
        "position error [cm max]": round(100 * float(distance.max()), 2),
        "newest pose's age at the end [s]": round((ended - int(estimate.stamps[-1])) * 1e-9, 3),
        "drops": {name: row["drops"] for name, row in nodes.items() if row.get("drops")},
        "lidar": counters["lidar"],
        "base": counters["base"],
        "localizer p95 [ms]": round(nodes["localizer"]["p95_ms"], 2),
        "cpu [% of one core]": round(100 * (used.ru_utime + used.ru_stime) / summary["wall_s"], 1),
        "peak memory [MB]": round(used.ru_maxrss / 1024, 1),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=300.0, metavar="S")
    parser.add_argument("--lidar", default="lds01")
    parser.add_argument("--base", default="opencr")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dirty", action="store_true")
    parser.add_argument("--every", type=float, default=0.0, metavar="S")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of the pipeline")
    parser.add_argument("--keep", metavar="DIR", help="keep everything in this folder")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(arguments.keep or temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for name, value in run(arguments, folder).items():
            print(f"{name:<34}{value}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
