"""An emulated base on a CAN bus that speaks AgileX protocol v2; needs the extra `can`."""

import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import can

from knotwork.core.clock import epoch
from knotwork.core.emulator.robot import Robot, WheelSample
from knotwork.core.emulator.watch import Event, Watch
from knotwork.core.errors import DriverError
from knotwork.core.geometry import Pose2
from knotwork.core.protocols import agilex
from knotwork.core.world.files import load_world
from knotwork.core.world.kinematics import body_twist, limited, wheel_speeds
from knotwork.core.world.parameters import BaseParameters
from knotwork.core.world.scene import World

_MOTION_PERIOD = 20_000_000  # ns
_STATE_PERIOD = 100_000_000
_WAIT = 0.005  # s

BODY = BaseParameters(
    wheel_radius=0.08,
    wheel_separation=0.36,
    radius=0.28,
    wheel_speed_max=1.6,
    acceleration=2.5,
    deceleration=3.0,
)


@dataclass(frozen=True, kw_only=True)
class AgilexSettings:
    """Where the base listens and stands.

    Attributes
    ----------
    interface, channel, port
        Of python-can; the port is for udp_multicast.
    world, seed, start, noise, truth, truth_frame, events
        As for the TurtleBot3.
    """

    interface: str = "udp_multicast"
    channel: str = "239.74.163.2"
    port: int = 43113
    world: str | World = "apartment"
    seed: int = 0
    start: Pose2 | None = None
    noise: bool = True
    truth: Path | None = None
    truth_frame: str = "map"
    events: Path | None = None


class AgilexBase:
    """The base; a context manager that runs it in a thread of its own.

    Raises
    ------
    DriverError
        The bus cannot be opened.

    Attributes
    ----------
    remote
        The remote control has taken over: the host's commands are ignored.
    emergency
        The emergency stop is pressed.
    silent
        The base sends nothing and hears nothing.
    battery
        [V]
    decoder
        Of what the host sends, with its counters.
    """

    def __init__(self, settings: AgilexSettings) -> None:
        world = load_world(settings.world) if isinstance(settings.world, str) else settings.world
        body = BODY if settings.noise else BODY.exact()
        self.remote = self.emergency = self.silent = False
        self.battery = 25.6
        self.decoder = agilex.Decoder()
        self.robot = Robot(world, body, settings.start, settings.seed, epoch())
        self._watch = Watch(self.robot, settings.truth, settings.truth_frame, settings.events)
        self._can_mode = False
        self._commanded = 0  # time of the last command
        self._moving = False
        self._counter = 0
        self._next_motion = self._next_state = self.robot.time
        options: dict[str, Any] = {"port": settings.port} if settings.interface == "udp_multicast" else {}
        try:
            self._bus: Any = can.Bus(interface=settings.interface, channel=settings.channel, **options)
        except (can.CanError, OSError, ValueError) as error:
            self._watch.close()
            raise DriverError(
                f"cannot open the CAN bus: {error}",
                where=f"{settings.interface} {settings.channel}",
                hint="another interface or channel of python-can?",
            ) from error
        self._lock = threading.Lock()
        self._stopping = False
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="emulator", daemon=True)

    def start(self) -> None:
        """Begin to live."""
        self.robot.begin(epoch())
        self._thread.start()

    def stop(self) -> None:
        """Leave the bus; raises what ended the thread if it was an error."""
        self._stopping = True
        if self._thread.is_alive():
            self._thread.join()
        self._bus.shutdown()
        self._watch.close()
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure

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
        return self._thread.is_alive()

    @property
    def wheels(self) -> list[WheelSample]:
        """True rim speeds, newest last; at least the last minute."""
        with self._lock:
            return list(self.robot.wheels)

    @property
    def events(self) -> list[Event]:
        """What happened, newest last."""
        with self._lock:
            return list(self._watch.events)

    def pose(self, frame: str = "map") -> Pose2:
        """Return the true pose now."""
        with self._lock:
            return self.robot.pose(frame)

    def rest_after(self, stamp: int, timeout: float = 5.0, settle: float = 0.3) -> float | None:
        """Wait until the wheels have stood for `settle` [s]; see `TurtleBot3.rest_after`."""
        give_up = epoch() + round(timeout * 1e9)
        while epoch() < give_up:
            with self._lock:
                rest = self._watch.rest_after(stamp)
            if rest is not None and epoch() - stamp > (rest + settle) * 1e9:
                return rest
            time.sleep(0.02)
        return None

    def _run(self) -> None:
        try:
            while not self._stopping:
                message = self._bus.recv(_WAIT)
                now = epoch()
                with self._lock:
                    self.robot.advance(now)
                    if message is not None and not self.silent and not message.is_error_frame:
                        self._receive(message.arbitration_id, message.data, now)
                    self._control(now)
                    self._send(now)
                    self._watch.look()
        except BaseException as error:  # noqa: BLE001  given to whoever stops the base
            self._failure = error

    def _receive(self, identifier: int, data: bytes | bytearray, now: int) -> None:
        frame = self.decoder.decode(identifier, data)
        if frame is None:
            return
        if frame.name == "ControlMode":
            self._can_mode = frame.signals["mode"] == agilex.CAN
            self._watch.note(now, "mode", {"can": float(self._can_mode)})
        elif frame.name == "MotionCommand" and self._listens():
            v, w = frame.signals["linear"], frame.signals["angular"]
            p = self.robot.parameters
            self.robot.drive(*limited(*wheel_speeds(v, w, p.wheel_separation), p.wheel_speed_max))
            self._commanded, self._moving = now, True
            self._watch.note(now, "command", {"v": v, "w": w})

    def _listens(self) -> bool:
        return self._can_mode and not self.remote and not self.emergency

    def _control(self, now: int) -> None:
        late = now - self._commanded >= agilex.COMMAND_TIMEOUT * 1e9
        if self._moving and (late or not self._listens()):
            self._moving = False
            self.robot.drive(0.0, 0.0)
            self._watch.note(now, "watchdog" if late else "override", {})

    def _send(self, now: int) -> None:
        if now >= self._next_motion:
            self._next_motion = max(self._next_motion + _MOTION_PERIOD, now + _MOTION_PERIOD // 2)
            p = self.robot.parameters
            v, w = body_twist(*self.robot.speeds, p.wheel_separation)
            left, right = (angle * p.wheel_radius for angle in self.robot.angles)
            self._put("MotionState", linear=v, angular=w)
            self._put("Odometer", left=left, right=right)
        if now >= self._next_state:
            self._next_state = max(self._next_state + _STATE_PERIOD, now + _STATE_PERIOD // 2)
            self._counter = (self._counter + 1) % 256
            mode = agilex.REMOTE if self.remote else agilex.CAN if self._can_mode else agilex.STANDBY
            vehicle = agilex.EMERGENCY_STOP if self.emergency else agilex.NORMAL
            self._put("SystemState", vehicle=vehicle, mode=mode, battery=self.battery, counter=self._counter)

    def _put(self, name: str, **signals: float) -> None:
        if self.silent:
            return
        identifier, data = agilex.encode(name, **signals)
        self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
