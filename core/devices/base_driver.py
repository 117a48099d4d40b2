"""The loop of a base: reads the wheels, writes what the supervisor allows, reconnects."""

from abc import abstractmethod
from threading import Thread
from time import sleep

from knotwork.core import clock
from knotwork.core.contracts import Context, Driver, PacketSource
from knotwork.core.devices.backoff import Backoff
from knotwork.core.devices.errors import DeviceLost, NoAnswer
from knotwork.core.devices.latency import Latency
from knotwork.core.devices.wake import Wake
from knotwork.core.errors import DriverError
from knotwork.core.messages import MotionControl, MotionState, Twist
from knotwork.core.safety.config import SafetyConfig
from knotwork.core.safety.supervisor import Supervisor

# ns between reads; boards refresh their registers every 20 ms. A little faster, and none is missed; and each read
# meets them at another age, down to none, which is what tells when a reading was taken.
_PERIOD = 19_800_000
_STOP_PATIENCE = 1.0  # s to come to a stand
_SILENT_FOR = 300_000_000  # ns of failed reads after which the device is taken for lost


class BaseDriver(Driver):
    """A driver of a base on wheels, with one thread that owns the device.

    The thread reads at 50 Hz and writes the wheels' speeds; a new command wakes it and is written at
    once. Whatever keeps the device from stopping by itself (heartbeat, bus watchdog, command frames) is
    fed by this thread only, and only while its reads succeed.

    A subclass says how to reach the hardware; all of it is called in one thread at a time, and may raise
    DeviceLost at any point.

    Parameters
    ----------
    context
    safety
    separation
        Distance between the wheels [m].
    fastest
        Limit of a rim [m/s].
    """

    def __init__(self, context: Context, safety: SafetyConfig, separation: float, fastest: float) -> None:
        super().__init__(context)
        self.safety = safety
        self.supervisor = Supervisor(safety, separation, fastest, context.report)
        self.latency = Latency()
        self.lateness = Latency()  # of the loop: how well the host keeps time
        self.discontinuity = False  # the next odometry cannot be compared with the one before
        self._lidar: PacketSource | None = context.uses.get("lidar") if safety.lidar_silence > 0 else None
        self._wake = Wake()
        self._thread: Thread | None = None
        self._connected = False
        self._stopping = self._ended = False
        self._told: tuple[str, str] | None = None
        self._good = 0  # time of the last good read [ns]
        self._commanded: int | None = None  # arrival of a command that has not been written yet
        self._crash: Exception | None = None
        context.every(0.1, self._look_after)

    # What a subclass does.

    @abstractmethod
    def connect(self, first: bool) -> None:
        """Open and identify the device; nothing moves yet. Raises DriverError or DeviceLost."""

    @abstractmethod
    def engage(self) -> None:
        """Make the wheels obey, standing; also after a fault has been re-armed."""

    @abstractmethod
    def poll(self, now: int) -> bool:
        """Read and emit; return whether the reading was good. Raises DeviceLost."""

    @abstractmethod
    def drive(self, left: float, right: float, now: int) -> int:
        """Write rim speeds [m/s] and feed the device's watchdog; return when the speeds were sent [ns]."""

    @abstractmethod
    def standing(self) -> bool:
        """Whether the wheels were measured to stand."""

    @abstractmethod
    def release(self) -> None:
        """Take the torque off, as far as the config wants it."""

    @abstractmethod
    def disconnect(self) -> None:
        """Close the device, whatever state it is in."""

    def pause(self, seconds: float, wake: Wake) -> None:
        """Wait, at most until `wake` is set."""
        wake.wait(seconds)

    def trouble(self) -> str:
        """Return why the device must not move now, "" for nothing."""
        return ""

    def reading_well(self, now: int) -> bool:
        """Whether readings came lately: only then may a watchdog be fed."""
        return now - self._good < _SILENT_FOR

    # What the runtime calls.

    def on_twist(self, message: Twist) -> None:
        """Take a command; it is written at once."""
        now = clock.epoch()
        if self.supervisor.command(message.vx, message.wz, message.stamp, now):
            if self._commanded is None:
                self._commanded = now
            self._wake.set()

    def on_control(self, message: MotionControl) -> None:
        """Take an emergency stop, or re-arm."""
        self.supervisor.request(message.action)
        self._wake.set()

    def open(self) -> None:
        """Reach the device; raises DriverError when that fails."""
        try:
            self.connect(first=True)
        except DeviceLost as lost:
            raise DriverError(str(lost), hint="`knotwork doctor` lists the devices that are there") from lost
        self._connected = True

    def start(self) -> None:
        """Start the thread."""
        self._thread = Thread(target=self._run, name=f"base {self.context.name}", daemon=True)
        self._thread.start()

    def stop_motion(self) -> None:
        """Ramp to a stop and wait until the wheels stand; callable from a signal handler."""
        self._stopping = True
        self._wake.set()
        until = clock.monotonic() + round(_STOP_PATIENCE * 1e9)
        while self._thread is not None and self._thread.is_alive() and clock.monotonic() < until:
            if not self._connected or (self.supervisor.standing and self.standing()):
                return
            sleep(0.005)

    def stop(self) -> None:
        """Take the torque off and end the thread."""
        self._ended = True
        self._wake.set()
        if self._thread is not None:
            self._thread.join(5.0)

    def close(self) -> None:
        """Close the device."""
        if self._connected:
            self._connected = False
            self.disconnect()

    def statistics(self) -> dict[str, float]:
        """Return the safety counters and how long commands took to be written."""
        return {
            **self.supervisor.counters,
            **self.latency.summary("command_latency"),
            **self.lateness.summary("loop_late"),
        }

    # The thread.

    def _run(self) -> None:
        backoff = Backoff()
        engaged = False
        lost_at = 0
        while not self._ended:
            try:
                if not self._connected:
                    self.connect(first=False)
                    self._connected = True
                    self.discontinuity = True
                    self._commanded = None  # what came meanwhile was not for it, and is no measure of its latency
                    self.context.count("reconnects")
                    self.context.report("info", f"back after {(clock.epoch() - lost_at) * 1e-9:.1f} s")
                    backoff.reset()
                    engaged = False
                if not engaged:
                    self.engage()
                    engaged = True
                    self._good = clock.epoch()
                self._loop()
                self._finish()
            except (DeviceLost, DriverError) as error:
                if self._connected:
                    lost_at = clock.epoch()
                    self.context.count("lost")
                    self.context.report("warning", f"lost the base: {error}; trying to reach it again")
                self._leave(f"the base is gone ({error})")
                self._pause(backoff.delay())
            except Exception as error:  # noqa: BLE001 - raised again in the run's own thread, see `_look_after`
                self._crash = error
                self._abandon()
                self._leave(f"{type(error).__name__}: {error}")
                return
        self.close()

    def _loop(self) -> None:
        """Read and write until the end."""
        due = clock.epoch()
        armed = self.supervisor.counters.get("rearmed", 0)
        while not self._ended:
            now = clock.epoch()
            if now >= due:
                self.lateness.add(now - due)
                due = max(due + _PERIOD, now)
                if self._poll(now):
                    self._good = now
                elif now - self._good > _SILENT_FOR:
                    raise DeviceLost(f"no good reading for {_SILENT_FOR * 1e-9:g} s")
            self._write()
            if self.supervisor.counters.get("rearmed", 0) != armed:
                armed = self.supervisor.counters["rearmed"]
                self.engage()
            self.pause((due - clock.epoch()) * 1e-9, self._wake)

    def _write(self) -> None:
        supervisor = self.supervisor
        now = clock.epoch()
        supervisor.problem = self.trouble() or self._silence(now)
        if self._stopping:
            supervisor.end()
        commanded, self._commanded = self._commanded, None
        left, right = supervisor.step(now)
        try:
            sent = self.drive(left, right, now)
            if commanded is not None:
                self.latency.add(sent - commanded)
        except NoAnswer:
            self.context.count("failed_writes")
        self._tell(now)

    def _silence(self, now: int) -> str:
        if self._lidar is None:
            return ""
        last = self._lidar.last_packet()
        if last == 0:
            return "no data from the lidar yet"
        return "the lidar is silent" if now - last > self.safety.lidar_silence * 1e9 else ""

    def _finish(self) -> None:
        """Stand, then let go; the loop has ended."""
        self._stopping = True
        until = clock.monotonic() + round(_STOP_PATIENCE * 1e9)
        while clock.monotonic() < until and not (self.supervisor.standing and self.standing()):
            self._poll(clock.epoch())
            self._write()
            self.pause(_PERIOD * 1e-9, self._wake)
        self.release()

    def _poll(self, now: int) -> bool:
        try:
            return self.poll(now)
        except NoAnswer:
            self.context.count("failed_reads")
            return False

    def _pause(self, seconds: float) -> None:
        """Wait before the next attempt; whoever asks to re-arm meanwhile is told why not."""
        until = clock.monotonic() + round(seconds * 1e9)
        while not self._ended and (left := until - clock.monotonic()) > 0:
            self._wake.wait(left * 1e-9)
            self.supervisor.step(clock.epoch())
            self._tell(clock.epoch())

    def _abandon(self) -> None:
        """Stop the wheels without a ramp; the device's own watchdog is the second way."""
        try:
            self.drive(0.0, 0.0, clock.epoch())
        except Exception:  # noqa: BLE001 - the first exception is the one to show
            self.context.count("abandoned")

    def _leave(self, why: str) -> None:
        self._connected = False
        self.disconnect()
        self.supervisor.lost(why)
        self._tell(clock.epoch())

    def _tell(self, now: int) -> None:
        state = (self.supervisor.state, self.supervisor.reason)
        if state != self._told:
            self._told = state
            self.context.emit("state", MotionState(stamp=now, state=state[0], reason=state[1]))

    def _look_after(self, time: int) -> None:
        """Let a mistake in the thread end the run, as any node's does."""
        if self._crash is not None:
            raise self._crash
