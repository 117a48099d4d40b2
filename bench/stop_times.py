"""How long the emulated robot's wheels turn after each kind of failure, drivers and all.

    python bench/stop_times.py [--repeat N] [CASE ...]

The drivers run in a process of their own (`knotwork run`) against a robot emulated in this one; wheel speeds
are the emulator's true ones, times its clock's. Prints a table; exits 1 when a time is over its limit.

The emulator is given precedence where the system allows it: the electronics of a robot do not become slow with
the computer.
"""

import argparse
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from knotwork.core.clock import epoch
from knotwork.core.emulator.agilex_base import AgilexBase, AgilexSettings
from knotwork.core.emulator.turtlebot3 import Settings, TurtleBot3

_HERE = Path(__file__).parent
_PROGRAM = (
    "import sys, knotwork.plugins as p; p.BUILTINS += ('steady_drive',);"
    "from knotwork.core.cli.main import main; sys.exit(main(sys.argv[1:]))"
)
_PIPELINE = "pipeline: stop\nnodes:\n{nodes}  drive: {{plugin: steady-drive, {drive}}}\n"
_BASES = {"opencr": "plugin: opencr, calibrate_gyro: false", "dynamixel": "plugin: dynamixel-wheels"}
_CRUISE = 0.5  # s at full speed before the failure
_PRECEDENCE = -10  # nice value of this process
_ATTEMPTS = 3
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
    cases = [
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
    return [
        case for case in cases if base != "agilex" or ("plugged" not in case.failure and "lidar" not in case.failure)
    ]


_WATCHDOGS = {"opencr": 0.7, "dynamixel": 0.3, "agilex": 0.7}  # s; the base itself must stop
CASES = {case.name: case for base, watchdog in _WATCHDOGS.items() for case in _cases(base, watchdog)}
Robot = TurtleBot3 | AgilexBase


class DroveOff(Exception):
    """The run did not come to drive, or did not stop."""


def measure(case: Case, folder: Path, seed: int = 0) -> float:
    """Return the time from the failure to the wheels' rest [s]; raises DroveOff."""
    with _robot(case.base, folder, seed) as (robot, nodes):
        drive = ", ".join(f"{key}: {value}" for key, value in ({"speed": 0.2} | case.drive).items())
        file = folder / "stop.yaml"
        file.write_text(_PIPELINE.format(nodes=nodes, drive=drive))
        out = folder / "out"
        log = (folder / "run.txt").open("w")
        environment = os.environ | {"PYTHONPATH": str(_HERE)}
        ordinary = ["nice", "-n", str(-os.getpriority(os.PRIO_PROCESS, 0))]
        command = [*ordinary, sys.executable, "-c", _PROGRAM, "run", str(file), "--out", str(out)]
        process = subprocess.Popen(command, stdout=log, stderr=log, env=environment, start_new_session=True)
        try:
            _await_speed(robot, process)
            stamp = _fail(case, robot, process, out)
            if not any(abs(sample.left) > _SPEED for sample in robot.wheels if abs(sample.stamp - stamp) < 50_000_000):
                raise DroveOff(f"{case.name}: the wheels stood before it")
            rest = robot.rest_after(stamp, timeout=10.0, settle=0.6)
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


@contextmanager
def _robot(base: str, folder: Path, seed: int) -> Iterator[tuple[Robot, str]]:
    """Yield the emulated robot, and the driver nodes of a pipeline for it."""
    if base == "agilex":
        port = 20_000 + os.getpid() % 20_000  # others on this machine may emulate as well
        with AgilexBase(AgilexSettings(world="arena", seed=seed, port=port)) as robot:
            where = f"interface: udp_multicast, channel: 239.74.163.2, udp_port: {port}"
            yield robot, f"  base: {{plugin: can-base, {where}}}\n"
        return
    with TurtleBot3(Settings(world="arena", base=base, seed=seed, folder=folder / "ports")) as robot:
        lidar = f"  lidar: {{plugin: lds01, port: {robot.lidar_path}}}\n"
        yield robot, f"{lidar}  base: {{{_BASES[base]}, port: {robot.base_path}}}\n"


def _await_speed(robot: Robot, process: "subprocess.Popen[bytes]") -> None:
    give_up = time.monotonic() + 60.0
    while min(robot.robot.speeds) < _SPEED:
        if process.poll() is not None or time.monotonic() > give_up:
            raise DroveOff("the robot does not set off")
        time.sleep(0.02)


def _fail(case: Case, robot: Robot, process: "subprocess.Popen[bytes]", out: Path) -> int:
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
    assert isinstance(robot, TurtleBot3)
    part, deed = case.failure.split()
    return robot.unplug(part) if deed == "unplugged" else robot.stall(part)  # type: ignore[arg-type]


def _measured(case: Case, seed: int) -> float:
    """Measure, again when a busy machine did not let the robot drive before the failure."""
    for attempt in range(_ATTEMPTS):
        try:
            with tempfile.TemporaryDirectory() as folder:
                return measure(case, Path(folder), seed)
        except DroveOff as why:
            print(f"{why}; attempt {attempt + 1} of {_ATTEMPTS}", file=sys.stderr, flush=True)
    raise DroveOff(f"{case.name}: no attempt succeeded")


def _precede() -> None:
    """Let this process, which is the robot, go before others; its children do not inherit it, see `measure`."""
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, _PRECEDENCE)
        Path("/proc/self/autogroup").write_text(str(_PRECEDENCE))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", nargs="*", help="words of the names of the cases (default: all)")
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="times for each (default 3)")
    arguments = parser.parse_args()
    _precede()
    late = False
    print(f"{'failure':<18}{'base':<12}{'median s':>9}{'worst s':>9}{'limit s':>9}")
    for case in CASES.values():
        if not all(word in case.name for word in arguments.case):
            continue
        times = []
        for seed in range(arguments.repeat):
            times.append(_measured(case, seed))
        late |= max(times) > case.limit
        print(
            f"{case.failure:<18}{case.base:<12}{statistics.median(times):>9.2f}{max(times):>9.2f}{case.limit:>9.2f}"
            f"{'  LATE' if max(times) > case.limit else ''}",
            flush=True,
        )
    return int(late)


if __name__ == "__main__":
    sys.exit(main())
