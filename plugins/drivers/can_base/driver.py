"""The driver of an AgileX base."""

from knotwork.core import clock
from knotwork.core.contracts import Context
from knotwork.core.devices.base_driver import BaseDriver
from knotwork.core.devices.errors import DeviceLost
from knotwork.core.devices.wake import Wake
from knotwork.core.devices.wheel_odometry import WheelOdometry
from knotwork.core.messages import Battery
from knotwork.core.protocols import agilex
from knotwork.core.protocols.agilex import Frame
from knotwork.core.world.kinematics import body_twist, wheel_speeds
from knotwork.plugins.drivers.can_base import Config
from knotwork.plugins.drivers.can_base.bus import CanBus

_MILLIMETRE = 1e-3  # of the odometer
_WAKE_UP = 2.0  # s for the first system state
_ASK_AGAIN = 100_000_000  # ns between requests for CAN mode
_FRESH = 100_000_000  # ns; odometer and system state come more often
_SLOW = 1_000_000_000  # ns between battery messages
_LAST_ZEROS = 5  # commands to stand before the base is left alone


class CanBase(BaseDriver):
    """Sends a command every 20 ms, and each new one at once; the base's own 500 ms watchdog is the second net."""

    def __init__(self, context: Context) -> None:
        config: Config = context.config
        self.config = config
        super().__init__(context, config.safety, config.wheel_separation, config.wheel_speed_max)
        self._bus: CanBus | None = None
        self._odometry = WheelOdometry(
            config.wheel_radius,
            config.wheel_separation,
            _MILLIMETRE / config.wheel_radius,
            config.wheel_speed_max,
            gyro=False,
            covariance=config.covariance,
        )
        self._vehicle = self._mode = -1
        self._seen = self._asked = self._slow = 0
        self._voltage = 0.0
        self._twist = (0.0, 0.0)
        self._measuring = False  # the run takes messages
        self._listened = False  # has been in CAN mode since it was engaged
        self._counters = {"frames": 0, "rejected_frames": 0, "unknown_frames": 0, "error_frames": 0}

    def connect(self, first: bool) -> None:
        """Open the bus and wait for the base's state."""
        bus = self._bus = CanBus(self.config)
        self._mode = -1
        self._measuring = False
        try:
            until = clock.epoch() + round(_WAKE_UP * 1e9)
            wake = Wake()
            while self._mode < 0:
                if clock.epoch() > until:
                    raise DeviceLost(f"no AgileX base on {self.config.interface} {self.config.channel}")
                bus.wait(0.02, wake)
                self._receive(clock.epoch())
        except BaseException:
            self.disconnect()
            raise
        if first:
            self.context.report("info", f"AgileX base, {self._voltage:.1f} V")

    def engage(self) -> None:
        """Have the base listen to CAN; the answer comes with its next state."""
        self._listened = False
        self._measuring = True
        self._send("ControlMode", mode=agilex.CAN)

    def pause(self, seconds: float, wake: Wake) -> None:
        """Take frames as they arrive, so that their stamps are right."""
        until = clock.epoch() + round(seconds * 1e9)
        while (left := until - clock.epoch()) > 0:
            assert self._bus is not None
            woken = self._bus.wait(left * 1e-9, wake)
            self._receive(clock.epoch())
            if woken:
                return

    def poll(self, now: int) -> bool:
        """Take what has arrived; good as long as the odometer is fresh."""
        self._receive(now)
        if self._mode == agilex.STANDBY:
            if self._listened:
                self._listened = False
                self.supervisor.fault("the base has gone to standby")
            elif now - self._asked >= _ASK_AGAIN and self.supervisor.state != "fault":
                self._asked = now
                self._send("ControlMode", mode=agilex.CAN)
        self._listened |= self._mode == agilex.CAN
        if now - self._slow >= _SLOW:
            self._slow = now
            self.context.emit("battery", Battery(stamp=now, voltage=self._voltage))
        return now - self._seen < _FRESH

    def drive(self, left: float, right: float, now: int) -> int:
        """Send the command; without fresh readings send none, so that the base's watchdog stops it."""
        if self.reading_well(now):
            v, w = body_twist(left, right, self.config.wheel_separation)
            self._send("MotionCommand", linear=v, angular=w)
        return clock.epoch()

    def standing(self) -> bool:
        """Whether the base says it stands."""
        return self._twist == (0.0, 0.0)

    def trouble(self) -> str:
        """Say who else has a hand on the base."""
        if self._vehicle == agilex.EMERGENCY_STOP:
            return "the emergency stop button is pressed"
        if self._vehicle == agilex.EXCEPTION:
            return "the base reports an exception"
        if self._mode == agilex.REMOTE:
            return "the remote control has taken over"
        if 0.0 < self._voltage < self.config.battery_min:
            return f"the battery is below {self.config.battery_min:g} V"
        return ""

    def release(self) -> None:
        """Stand, then standby."""
        for _ in range(_LAST_ZEROS):
            self._send("MotionCommand", linear=0.0, angular=0.0)
        if self.config.standby and self._mode == agilex.CAN:
            self._send("ControlMode", mode=agilex.STANDBY)

    def disconnect(self) -> None:
        """Leave the bus."""
        bus, self._bus = self._bus, None
        if bus is not None:
            self._counters = self._frames(bus)
            bus.close()

    def statistics(self) -> dict[str, float]:
        """Add what came over the bus."""
        own = {"rejected_readings": self._odometry.rejected, "encoder_restarts": self._odometry.restarts}
        bus = self._bus
        return {**super().statistics(), **(self._counters if bus is None else self._frames(bus)), **own}

    def _frames(self, bus: CanBus) -> dict[str, int]:
        decoder = bus.decoder
        return {
            "frames": self._counters["frames"] + decoder.packets,
            "rejected_frames": self._counters["rejected_frames"] + decoder.rejected,
            "unknown_frames": self._counters["unknown_frames"] + decoder.unknown,
            "error_frames": self._counters["error_frames"] + bus.error_frames,
        }

    def _send(self, name: str, **signals: float) -> None:
        assert self._bus is not None
        self._bus.send(name, **signals)

    def _receive(self, now: int) -> None:
        assert self._bus is not None
        there, frame = self._bus.frame()
        while there:
            if frame is not None:
                self._take(frame, now)
            there, frame = self._bus.frame()

    def _take(self, frame: Frame, now: int) -> None:
        signals = frame.signals
        if frame.name == "SystemState":
            self._vehicle, self._mode = int(signals["vehicle"]), int(signals["mode"])
            self._voltage = signals["battery"]
        elif frame.name == "MotionState":
            self._twist = signals["linear"], signals["angular"]
        elif frame.name == "Odometer" and self._measuring:
            self._measure(signals["left"], signals["right"], now)

    def _measure(self, left: float, right: float, now: int) -> None:
        if self.discontinuity:
            self._odometry.restart()
            self.discontinuity = False
        ticks = round(left / _MILLIMETRE), round(right / _MILLIMETRE)
        rims = wheel_speeds(*self._twist, self.config.wheel_separation)
        velocity = rims[0] / self.config.wheel_radius, rims[1] / self.config.wheel_radius
        restarts = self._odometry.restarts
        found = self._odometry.update(now, ticks, velocity, None)
        if found is None:
            return
        self._seen = now
        if self._odometry.restarts != restarts:
            self.supervisor.fault("the base's odometer has restarted")
        self.context.emit("wheels", found[1])
        self.context.emit("odometry", found[0])
