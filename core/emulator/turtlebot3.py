"""An emulated TurtleBot3: lidar and base on pseudo-terminals, a body in a simulated world."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

from knotwork.core.clock import epoch
from knotwork.core.emulator.folder import LinkFolder
from knotwork.core.emulator.lidars import Lds01, Lds02, Lds03, Lidar
from knotwork.core.emulator.line import Line
from knotwork.core.emulator.loop import Loop
from knotwork.core.emulator.motor_bus import MotorBus
from knotwork.core.emulator.opencr_board import MODELS, OpenCr
from knotwork.core.emulator.robot import Robot, WheelSample
from knotwork.core.emulator.watch import Event, Watch
from knotwork.core.emulator.xl430_motor import Motor
from knotwork.core.errors import InputError
from knotwork.core.geometry import Pose2
from knotwork.core.protocols import xl430
from knotwork.core.world.files import load_world
from knotwork.core.world.parameters import BaseParameters, LidarParameters
from knotwork.core.world.scene import World
from knotwork.core.world.seeding import generator

# The mechanics; the firmware's limits are far below.
_BODIES = {
    "burger": BaseParameters(
        wheel_separation=0.160, radius=0.105, wheel_speed_max=0.35, acceleration=4.0, deceleration=4.0
    ),
    "waffle": BaseParameters(
        wheel_separation=0.287, radius=0.220, wheel_speed_max=0.35, acceleration=4.0, deceleration=4.0
    ),
}
_MOUNTS = {"burger": (-0.032, 0.0, 0.0), "waffle": (-0.064, 0.0, 0.0)}
_MOTORS = {"burger": xl430.XL430, "waffle": xl430.XM430}
_LIDARS = {
    "lds01": (Lds01, {"rate": 5.0, "range_min": 0.12, "range_max": 3.5}),
    "lds02": (Lds02, {"rate": 6.0, "range_min": 0.16, "range_max": 8.0}),
    "lds03": (Lds03, {"rate": 10.0, "range_min": 0.05, "range_max": 12.0}),
}
# Names as udev gives them under /dev/serial/by-id.
_LINKS = {
    "lidar": "usb-Silicon_Labs_CP2102_USB_to_UART_Bridge_Controller_0001-if00-port0",
    "opencr": "usb-ROBOTIS_OpenCR_Virtual_ComPort_in_FS_Mode_FFFFFFFEFFFF-if00",
    "dynamixel": "usb-FTDI_USB__-__Serial_Converter_FT0001-if00-port0",
}

Part = Literal["lidar", "base"]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How the robot is built and where it stands.

    Attributes
    ----------
    world
        Name of a shipped world, path of a world's YAML, or a `World`.
    lidar, base, model
        "lds01", "lds02" or "lds03", "opencr" or "dynamixel", "burger" or "waffle".
    firmware
        Of the OpenCR: 5, or 4 with its read fault.
    seed
        Of slip, noise and line faults.
    start
        Pose in the world; None: the world's own.
    noise
        False: no slip, no sensor errors; encoders and gyro still count in steps.
    range_error
        Sigma of the lidar's scale error, drawn once from the seed.
    spin_up
        From power-on of the lidar to its first packet [s]; the robot starts with the lidar spinning.
    folder
        For the links to the terminals; None: a temporary one.
    truth, truth_frame, events
        See `Watch`.
    """

    world: str | World = "apartment"
    lidar: str = "lds01"
    base: str = "opencr"
    model: str = "burger"
    firmware: int = 5
    seed: int = 0
    start: Pose2 | None = None
    noise: bool = True
    range_error: float = 0.0
    spin_up: float = 2.0
    folder: Path | None = None
    truth: Path | None = None
    truth_frame: str = "map"
    events: Path | None = None


class TurtleBot3:
    """The robot; a context manager that runs it in a thread of its own.

    A host in the same process that waits by spinning, as ROBOTIS's SDK does, starves that thread unless
    `sys.setswitchinterval` is short.

    Raises
    ------
    InputError
        An unknown world, a file or folder that cannot be written, a start inside an obstacle.

    Attributes
    ----------
    robot, lidar, board
        The body; the device; `OpenCr` or `MotorBus`. Their attributes may be read at any time, and
        changed through `call`.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        world = load_world(settings.world) if isinstance(settings.world, str) else settings.world
        body, (lidar, limits) = _BODIES[settings.model], _LIDARS[settings.lidar]
        beams = LidarParameters(mount=_MOUNTS[settings.model], accuracy=settings.range_error, **limits)  # type: ignore[arg-type]
        if not settings.noise:
            body, beams = body.exact().model_copy(update={"ticks": body.ticks}), beams.exact()
        self.robot = Robot(world, body, settings.start, settings.seed, epoch())
        room = self.robot.obstacles.clearance(*self.robot.start[:2])
        if room <= body.radius:
            raise InputError(
                f"the robot cannot stand at {list(self.robot.start)}: an obstacle is {room:.3f} m away, "
                f"its radius is {body.radius} m"
            )
        self._watch = Watch(self.robot, settings.truth, settings.truth_frame, settings.events)
        self._own_folder: LinkFolder | None = None
        try:
            if settings.folder is None:
                self._own_folder = LinkFolder()
                self.folder = self._own_folder.path
            else:
                self.folder = settings.folder
                self.folder.mkdir(parents=True, exist_ok=True)
            self._lines: dict[str, Line] = {
                "lidar": Line(self.folder / _LINKS["lidar"], generator(settings.seed, "lidar line")),
                "base": Line(self.folder / _LINKS[settings.base], generator(settings.seed, "base line")),
            }
        except OSError as error:
            raise InputError(f"cannot make the links: {error.strerror}", where=str(error.filename)) from error
        self.lidar: Lidar = lidar(self._lines["lidar"], self.robot, beams, settings.seed, settings.spin_up)
        self.board: OpenCr | MotorBus = self._make_base()
        self._loop = Loop((self.lidar, self.board), self._advance)

    def _make_base(self) -> OpenCr | MotorBus:
        line, model = self._lines["base"], self.settings.model
        random = generator(self.settings.seed, "encoders")
        if self.settings.base == "opencr":
            return OpenCr(line, self.robot, model, self.settings.firmware, random, self._watch.note)
        left, right = (int(z) for z in random.integers(0, xl430.TICKS, 2))
        motors = (
            Motor(xl430.LEFT, _MOTORS[model], False, 0, left),
            Motor(xl430.RIGHT, _MOTORS[model], True, xl430.REVERSE, right),
        )
        return MotorBus(line, self.robot, motors, self._watch.note)

    # --- its life -----------------------------------------------------------------------------

    def start(self) -> None:
        """Begin to live."""
        self.robot.begin(epoch())
        self.lidar.begin()
        self._loop.start()

    def stop(self) -> None:
        """Unplug everything and write what is left of the files."""
        try:
            self._loop.stop()
        finally:
            for line in self._lines.values():
                line.close()
            self._watch.close()
            if self._own_folder is not None:
                self._own_folder.remove()

    def __enter__(self) -> Self:
        """Start."""
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop."""
        self.stop()

    @property
    def alive(self) -> bool:
        """Whether its thread runs; `stop` raises what ended it."""
        return self._loop.alive

    def _advance(self, now: int) -> int:
        self.robot.advance(now)
        return self._watch.look()

    # --- what a host sees ---------------------------------------------------------------------

    @property
    def lidar_path(self) -> str:
        """Path to open; stays the same when the device is replugged under another terminal."""
        return str(self._lines["lidar"].link)

    @property
    def base_path(self) -> str:
        """Path to open; stays the same when the device is replugged under another terminal."""
        return str(self._lines["base"].link)

    # --- faults -------------------------------------------------------------------------------

    def line(self, part: Part) -> Line:
        """Return the line of a part, for its counters."""
        return self._lines[part]

    def unplug(self, part: Part) -> int:
        """Pull the plug; returns when [ns since 1970]."""

        def work() -> int:
            now = epoch()
            self._lines[part].unplug()
            self._watch.note(now, "unplug", {"lidar": float(part == "lidar")})
            return now

        return self._loop.call(work)

    def replug(self, part: Part) -> int:
        """Put it back, under another terminal behind the same link; returns when [ns since 1970]."""

        def work() -> int:
            now = epoch()
            self._lines[part].plug()
            if part == "lidar":  # the plug is its power as well
                self.lidar.power_on(now)
            else:
                self.board.parser.reset()
            self._watch.note(now, "plug", {"lidar": float(part == "lidar")})
            return now

        return self._loop.call(work)

    def stall(self, part: Part, stalled: bool = True) -> int:
        """Lose all bytes of a part, or stop losing them; returns when [ns since 1970]."""

        def work() -> int:
            now = epoch()
            self._lines[part].stalled = stalled
            figures = {"lidar": float(part == "lidar"), "on": float(stalled)}
            self._watch.note(now, "stall", figures)
            return now

        return self._loop.call(work)

    def disturb(self, part: Part, drop: float = 0.0, flip: float = 0.0, latency: float = 0.0) -> None:
        """Set probability of lost bytes and of flipped bits, and the longest delay of 64 bytes [s]."""

        def work() -> None:
            line = self._lines[part]
            line.noise.drop, line.noise.flip, line.latency = drop, flip, latency

        self._loop.call(work)

    # --- what it truly did --------------------------------------------------------------------

    @property
    def wheels(self) -> list[WheelSample]:
        """True rim speeds, newest last; at least the last minute."""
        return self._loop.call(lambda: list(self.robot.wheels))

    @property
    def events(self) -> list[Event]:
        """What happened, newest last."""
        return self._loop.call(lambda: list(self._watch.events))

    @property
    def path_length(self) -> float:
        """Distance driven [m]."""
        return self._watch.length

    def pose(self, frame: str = "map") -> Pose2:
        """Return the true pose now."""
        return self._loop.call(lambda: self.robot.pose(frame))

    def rest_after(self, stamp: int, timeout: float = 5.0, settle: float = 0.3) -> float | None:
        """Wait until the wheels have stood for `settle` [s].

        Returns
        -------
        time from `stamp` [ns since 1970] to standing [s]; None if they still turn after `timeout` [s]
        """
        give_up = epoch() + round(timeout * 1e9)
        while epoch() < give_up:
            rest = self._loop.call(lambda: self._watch.rest_after(stamp))
            if rest is not None and epoch() - stamp > (rest + settle) * 1e9:
                return rest
            time.sleep(0.02)
        return None


def parts() -> dict[str, tuple[str, ...]]:
    """Return the choices of `Settings`."""
    return {"lidar": tuple(_LIDARS), "base": ("opencr", "dynamixel"), "model": tuple(MODELS)}
