"""Decides what the wheels of a base may do now."""

from collections import deque
from collections.abc import Callable
from math import isfinite
from typing import Literal

from knotwork.core.safety.config import SafetyConfig
from knotwork.core.safety.ramp import WheelRamp, wheel_goal

State = Literal["ready", "waiting", "fault", "emergency"]
Report = Callable[[Literal["info", "warning", "error"], str], None]

_STEP_MAX = 0.05  # s; after a pause of the loop a ramp goes on from where it was
_AUTO_AFTER = 1_000_000_000  # ns that all must be well before `rearm: auto` re-arms


class Supervisor:
    """Takes commands and faults, gives ramped rim speeds.

    All times are of one monotone clock, the run's: in real that is `clock.epoch()`, by which devices stamp
    their messages, so that the `stamp` of a command, the run's time at its emission, tells its age.

    `command` and `request` may come from another thread; everything else belongs to the thread that
    writes to the hardware.

    Parameters
    ----------
    config
    separation
        Distance between the wheels [m].
    fastest
        Limit of a rim [m/s].
    report
        Called with level and text.

    Attributes
    ----------
    problem
        Why the base must not move at present ("" for nothing); set by the driver. It becomes a fault
        once the base has been ready.
    counters
        Refused commands and stops, by cause.
    """

    def __init__(self, config: SafetyConfig, separation: float, fastest: float, report: Report) -> None:
        self.config = config
        self.problem = "not connected yet"
        self.counters: dict[str, int] = {}
        self.ramp = WheelRamp(config.acceleration, config.deceleration)
        self._separation = separation
        self._fastest = fastest
        self._report = report
        self._timeout = round(config.command_timeout * 1e9)
        self._command: tuple[float, float, int] | None = None
        self._requests: deque[Literal["stop", "rearm"]] = deque()
        self._reason = ""
        self._emergency = False
        self._begun = False  # has been ready once
        self._well_since: int | None = None
        self._ended = False
        self._last: int | None = None  # time of the last step

    @property
    def state(self) -> State:
        """`ready`, `waiting` (for the first data), `fault` or `emergency`."""
        if self._emergency:
            return "emergency"
        if self._reason:
            return "fault"
        return "waiting" if self.problem else "ready"

    @property
    def reason(self) -> str:
        """Why the base stands, "" when it need not."""
        return self._reason or self.problem

    @property
    def standing(self) -> bool:
        """Whether the wheels are told to stand."""
        return self.ramp.standing

    def resize(self, separation: float, fastest: float) -> None:
        """Take the geometry of the base that was found [m, m/s]."""
        self._separation, self._fastest = separation, fastest

    def command(self, v: float, w: float, stamp: int, now: int) -> bool:
        """Take a command emitted at `stamp` [ns]: forward speed [m/s], yaw rate [rad/s]; False: refused."""
        if not (isfinite(v) and isfinite(w)):
            self._count("invalid_commands")
            return False
        if now - stamp > self._timeout:
            self._count("stale_commands")
            return False
        self._command = (v, w, min(stamp, now))  # a stamp from the future must not live longer
        return True

    def request(self, action: Literal["stop", "rearm"]) -> None:
        """Ask for an emergency stop or for re-arming."""
        self._requests.append(action)

    def fault(self, reason: str) -> None:
        """Stop, and stand until re-armed."""
        self._command = None
        self._well_since = None
        if not self._reason:
            self._reason = reason
            self._count("faults")
            self._report("warning", f"{reason}: the base stops and stands until re-armed")

    def end(self) -> None:
        """Stop for good: the run ends."""
        self._ended = True

    def lost(self, reason: str) -> None:
        """Note that the base is out of reach: whatever it did, it stands when it comes back."""
        self.problem = reason
        self._watch(0)
        self.ramp.reset()

    def step(self, now: int) -> tuple[float, float]:
        """Return the rim speeds to write at `now` [ns]."""
        period = 0.0 if self._last is None else min(max(now - self._last, 0) * 1e-9, _STEP_MAX)
        self._last = now
        self._watch(now)
        while self._requests:
            self._handle(self._requests.popleft())
        return self.ramp.step(*self._goal(now), period)

    def _watch(self, now: int) -> None:
        if self.problem:
            self._well_since = None
            if self._begun:
                self.fault(self.problem)
            return
        self._begun = True
        if self._reason and not self._emergency and self.config.rearm == "auto":
            if self._well_since is None:
                self._well_since = now
            elif now - self._well_since >= _AUTO_AFTER:
                self._rearm("re-armed by itself")

    def _handle(self, action: Literal["stop", "rearm"]) -> None:
        if action == "stop":
            self._emergency = True
            self.fault("emergency stop")
            self._reason = "emergency stop"
        elif not self._reason:
            return
        elif self.problem:
            self._report("warning", f"cannot re-arm: {self.problem}")
        else:
            self._rearm("re-armed")

    def _rearm(self, text: str) -> None:
        self._reason = ""
        self._emergency = False
        self._command = None  # nothing that was asked for before may move the base now
        self._count("rearmed")
        self._report("info", text)

    def _goal(self, now: int) -> tuple[float, float]:
        command = self._command
        if command is None or self._ended or self.state != "ready":
            return 0.0, 0.0
        v, w, stamp = command
        if now - stamp > self._timeout:
            if self._command is command:
                self._command = None
            if not self.ramp.standing:
                self._count("command_timeouts")
                self._report("warning", f"no command for {self.config.command_timeout:g} s: stopping")
            return 0.0, 0.0
        return wheel_goal(v, w, self._separation, self._fastest, self.config.speed, self.config.yaw_rate)

    def _count(self, name: str) -> None:
        self.counters[name] = self.counters.get(name, 0) + 1
