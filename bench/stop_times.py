"""How long the emulated robot's wheels turn after each kind of failure, drivers and all.

    python bench/stop_times.py [--repeat N] [CASE ...]

The drivers run in a process of their own (`knotwork run`) against a robot emulated in this one; wheel speeds
are the emulator's true ones, times its clock's. Prints a table; exits 1 when a time is over its limit.
"""

import argparse
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from knotwork.core.clock import epoch
from knotwork.core.emulator.turtlebot3 import Settings, TurtleBot3

_HERE = Path(__file__).parent
_PROGRAM = (
    "import sys, knotwork.plugins as p; p.BUILTINS += ('steady_drive',);"
    "from knotwork.core.cli.main import main; sys.exit(main(sys.argv[1:]))"
)
_PIPELINE = """
pipeline: stop
nodes:
  lidar: {{plugin: lds01, port: {lidar}}}
  base: {{{base_plugin}, port: {base}}}
  drive: {{plugin: steady-drive, {drive}}}
"""
_BASES = {"opencr": "plugin: opencr, calibrate_gyro: false", "dynamixel": "plugin: dynamixel-wheels"}
_CRUISE = 1.0  # s at full speed before the failure
_SPEED = 0.19  # m/s that count as full speed


@dataclass(frozen=True)
class Case:
    """A failure, the base it happens to, and how long the wheels may turn after it [s]."""

    failure: str
    base: str
    limit: float
    drive: dict[str, object] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return f"{self.failure} {self.base}"


def _cases(base: str, watchdog: float) -> list[Case]:
    return [
        Case("SIGINT", base, 0.5),
        Case("SIGTERM", base, 0.5),
        Case("SIGKILL", base, watchdog),
        Case("exception", base, 0.5, {"after": 3.0, "then": "raise"}),
        Case("commands lost", base, 0.5, {"after": 3.0, "then": "silence"}),
        Case("commands NaN", base, 0.5, {"after": 3.0, "then": "nan"}),
        Case("lidar unplugged", base, 0.5),
        Case("lidar stalled", base, 0.5),
        Case("base unplugged", base, watchdog),
    ]


CASES = {case.name: case for base, watchdog in (("opencr", 0.7), ("dynamixel", 0.3)) for case in _cases(base, watchdog)}


class DroveOff(Exception):
    """The run did not come to drive, or did not stop."""


def measure(case: Case, folder: Path, seed: int = 0) -> float:
    """Return the time from the failure to the wheels' rest [s]; raises DroveOff."""
    with TurtleBot3(Settings(world="arena", base=case.base, seed=seed, folder=folder / "ports")) as robot:
        drive = ", ".join(f"{key}: {value}" for key, value in ({"speed": 0.2} | case.drive).items())
        file = folder / "stop.yaml"
        file.write_text(
            _PIPELINE.format(lidar=robot.lidar_path, base=robot.base_path, drive=drive, base_plugin=_BASES[case.base])
        )
        out = folder / "out"
        log = (folder / "run.txt").open("w")
        environment = os.environ | {"PYTHONPATH": str(_HERE)}
        command = [sys.executable, "-c", _PROGRAM, "run", str(file), "--out", str(out)]
        process = subprocess.Popen(command, stdout=log, stderr=log, env=environment)
        try:
            _await_speed(robot, process)
            stamp = _fail(case, robot, process, out)
            if not any(abs(sample.left) > _SPEED for sample in robot.wheels if abs(sample.stamp - stamp) < 50_000_000):
                raise DroveOff(f"{case.name}: the wheels stood before it")
            rest = robot.rest_after(stamp, timeout=10.0, settle=1.0)
            if rest is None:
                raise DroveOff(f"{case.name}: the wheels still turn after 10 s")
            return rest
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(20.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            log.close()


def _await_speed(robot: TurtleBot3, process: "subprocess.Popen[bytes]") -> None:
    give_up = time.monotonic() + 60.0
    while min(robot.robot.speeds) < _SPEED:
        if process.poll() is not None or time.monotonic() > give_up:
            raise DroveOff("the robot does not set off")
        time.sleep(0.02)


def _fail(case: Case, robot: TurtleBot3, process: "subprocess.Popen[bytes]", out: Path) -> int:
    """Let it happen; return when [ns since 1970]."""
    if case.drive:
        said = out / "failed_at"
        give_up = time.monotonic() + 30.0
        while not (said.exists() and said.read_text()):
            if time.monotonic() > give_up:
                raise DroveOff("the policy does not fail")
            time.sleep(0.01)
        return int(said.read_text())
    time.sleep(_CRUISE)
    if case.failure.startswith("SIG"):
        stamp = epoch()
        process.send_signal(getattr(signal, case.failure))
        return stamp
    part, deed = case.failure.split()
    return robot.unplug(part) if deed == "unplugged" else robot.stall(part)  # type: ignore[arg-type]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", nargs="*", help="words of the names of the cases (default: all)")
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="times for each (default 3)")
    arguments = parser.parse_args()
    late = False
    print(f"{'failure':<18}{'base':<12}{'median s':>9}{'worst s':>9}{'limit s':>9}")
    for case in CASES.values():
        if not all(word in case.name for word in arguments.case):
            continue
        times = []
        for seed in range(arguments.repeat):
            with tempfile.TemporaryDirectory() as folder:
                times.append(measure(case, Path(folder), seed))
        late |= max(times) > case.limit
        print(
            f"{case.failure:<18}{case.base:<12}{statistics.median(times):>9.2f}{max(times):>9.2f}{case.limit:>9.2f}"
            f"{'  LATE' if max(times) > case.limit else ''}",
            flush=True,
        )
    return int(late)


if __name__ == "__main__":
    sys.exit(main())
