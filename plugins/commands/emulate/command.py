"""The subcommand: builds the robot, says where its devices are, and lets it live until it is stopped."""

import math
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, Protocol

from knotwork.core.clock import monotonic
from knotwork.core.collector import settled
from knotwork.core.contracts import Command
from knotwork.core.emulator.turtlebot3 import Settings, TurtleBot3, parts
from knotwork.core.errors import InputError
from knotwork.plugins.commands.emulate.faults import PARTS, Fault, rates, timed


class _Robot(Protocol):
    @property
    def alive(self) -> bool: ...
    def start(self) -> None: ...
    def stop(self) -> None: ...


class Emulate(Command):
    """`emulate turtlebot3` and `emulate agilex`."""

    def arguments(self, parser: Any) -> None:
        """Add both robots and their options."""
        forms = parser.add_subparsers(dest="robot", required=True, metavar="{turtlebot3,agilex}")
        choices = parts()
        form = forms.add_parser("turtlebot3", help="lidar and base on pseudo-terminals")
        form.add_argument("--lidar", choices=choices["lidar"], default="lds01", help="which lidar it carries")
        form.add_argument("--base", choices=choices["base"], default="opencr", help="opencr, or two bare motors")
        form.add_argument("--model", choices=choices["model"], default="burger", help="which robot")
        form.add_argument("--firmware", type=int, choices=(4, 5), default=5, help="of the OpenCR; 4 has the read fault")
        form.add_argument("--spin-up", type=float, default=2.0, metavar="S", help="of the lidar after power-on")
        form.add_argument(
            "--range-error", type=float, default=0.0, metavar="SIGMA", help="of the lidar's scale error, 0 is none"
        )
        form.add_argument("--ports", metavar="FOLDER", help="where to put the links; else a temporary folder")
        _world(form)
        group = form.add_argument_group("faults", "DEVICE is lidar or base; without it both; may be repeated")
        for option, metavar, help_ in (
            ("--drop-bytes", "[DEVICE=]P", "probability of a byte to be lost"),
            ("--flip-bits", "[DEVICE=]P", "probability of a bit to be inverted"),
            ("--stall", "[DEVICE=]AT[:FOR]", "lose all bytes from AT for FOR seconds"),
            ("--unplug-at", "[DEVICE=]AT[:FOR]", "unplug at AT, plug in again FOR seconds later"),
        ):
            group.add_argument(option, action="append", default=[], metavar=metavar, help=help_)
        group.add_argument("--latency", type=float, default=0.0, metavar="S", help="longest delay of 64 bytes")
        form = forms.add_parser("agilex", help="a CAN base that speaks AgileX protocol v2")
        form.add_argument("--interface", default="udp_multicast", help="of python-can")
        form.add_argument("--channel", default="239.74.163.2", help="of the interface")
        form.add_argument("--port", type=int, default=43113, help="of udp_multicast")
        _world(form)

    def run(self, arguments: Any) -> int:
        """Live until a signal or the end of `--duration`; raises InputError for what cannot be built."""
        _check(arguments)
        if arguments.robot == "agilex":
            try:
                from knotwork.core.emulator.agilex_base import AgilexBase, AgilexSettings
            except ModuleNotFoundError as error:
                raise InputError(f"the CAN base needs {error.name}", hint="pip install 'knotwork[can]'") from error

            base = AgilexBase(
                AgilexSettings(
                    interface=arguments.interface,
                    channel=arguments.channel,
                    port=arguments.port,
                    world=arguments.world,
                    seed=arguments.seed,
                    noise=not arguments.exact,
                    truth=_path(arguments.truth),
                    truth_frame=arguments.truth_frame,
                    events=_path(arguments.events),
                )
            )
            return _live(base, [f"can: {arguments.interface} {arguments.channel}"], [], arguments.duration)
        faults = timed("--stall", "stall", arguments.stall) + timed("--unplug-at", "unplug", arguments.unplug_at)
        drop, flip = rates("--drop-bytes", arguments.drop_bytes), rates("--flip-bits", arguments.flip_bits)
        robot = TurtleBot3(
            Settings(
                world=arguments.world,
                lidar=arguments.lidar,
                base=arguments.base,
                model=arguments.model,
                firmware=arguments.firmware,
                seed=arguments.seed,
                noise=not arguments.exact,
                range_error=arguments.range_error,
                spin_up=arguments.spin_up,
                folder=_path(arguments.ports),
                truth=_path(arguments.truth),
                truth_frame=arguments.truth_frame,
                events=_path(arguments.events),
            )
        )
        for part in PARTS:
            robot.disturb(part, drop[part], flip[part], arguments.latency)
        paths = [f"lidar: {robot.lidar_path}", f"base: {robot.base_path}"]
        return _live(robot, paths, _schedule(robot, faults), arguments.duration)


def _world(form: Any) -> None:
    form.add_argument("--world", default="apartment", help="name of a shipped world, or path of its YAML")
    form.add_argument("--seed", type=int, default=0, help="of all noise and faults")
    form.add_argument("--exact", action="store_true", help="no slip and no sensor noise")
    form.add_argument("--duration", type=float, metavar="S", help="stop after that long")
    form.add_argument("--truth", metavar="FILE", help="write the true path (TUM)")
    form.add_argument("--truth-frame", choices=("map", "world"), default="map", help="map: the start is the origin")
    form.add_argument("--events", metavar="FILE", help="write commands, watchdogs and faults as JSON lines")


def _check(arguments: Any) -> None:
    bounds = {
        "seed": (0.0, math.inf, "0 or more"),
        "duration": (0.0, math.inf, "0 s or more"),
        "spin_up": (0.0, 60.0, "from 0 to 60 s"),
        "range_error": (0.0, 0.49, "from 0 to 0.49"),
        "latency": (0.0, 1.0, "from 0 to 1 s"),
    }
    for name, (low, high, expected) in bounds.items():
        value = getattr(arguments, name, None)
        if value is not None and not low <= value <= high:
            raise InputError(f"expected {expected}, found {value}", where="--" + name.replace("_", "-"))


def _path(text: str | None) -> Path | None:
    return None if text is None else Path(text)


def _schedule(robot: TurtleBot3, faults: list[Fault]) -> list[tuple[float, Callable[[], object]]]:
    deeds: list[tuple[float, Callable[[], object]]] = []
    for fault in faults:
        part = fault.part
        begin, end = (
            (lambda part=part: robot.stall(part), lambda part=part: robot.stall(part, False))
            if fault.kind == "stall"
            else (lambda part=part: robot.unplug(part), lambda part=part: robot.replug(part))
        )
        deeds.append((fault.at, begin))
        if fault.length is not None:
            deeds.append((fault.at + fault.length, end))
    return sorted(deeds, key=lambda deed: deed[0])


def _live(
    robot: _Robot,
    lines: list[str],
    deeds: list[tuple[float, Callable[[], object]]],
    duration: float | None,
) -> int:
    end = threading.Event()

    def stop(_signal: int, _frame: FrameType | None) -> None:
        end.set()

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        robot.start()
        started = monotonic()
        sys.stdout.write("".join(f"{line}\n" for line in lines))
        sys.stdout.flush()
        with settled():
            while robot.alive and not end.is_set():
                passed = (monotonic() - started) * 1e-9
                while deeds and deeds[0][0] <= passed:
                    deeds.pop(0)[1]()
                if duration is not None and passed >= duration:
                    break
                until = [0.2]
                until += [deed[0] - passed for deed in deeds[:1]]
                until += [duration - passed] if duration is not None else []
                end.wait(max(0.0, min(until)))
    finally:
        robot.stop()
        for number, handler in before.items():
            signal.signal(number, handler)
    return 0
