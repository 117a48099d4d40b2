"""The emulated CAN base on python-can's virtual bus."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import can
import pytest

from knotwork.core.clock import epoch
from knotwork.core.emulator.agilex_base import AgilexBase, AgilexSettings
from knotwork.core.errors import DriverError
from knotwork.core.protocols import agilex


class Host:
    def __init__(self, bus: Any) -> None:
        self.bus = bus
        self.decoder = agilex.Decoder()
        self.latest: dict[str, dict[str, float]] = {}
        self.counts: dict[str, int] = {}

    def send(self, frame: tuple[int, bytes]) -> None:
        self.bus.send(can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False))

    def live(self, done: Callable[[], bool], command: tuple[int, bytes] | None = None) -> None:
        """Command and listen until something holds; the test machine may be slow."""
        give_up = time.monotonic() + 30.0
        due = 0.0
        while not done():
            assert time.monotonic() < give_up
            if command and time.monotonic() >= due:
                due = time.monotonic() + agilex.COMMAND_PERIOD
                self.send(command)
            message = self.bus.recv(0.005)
            frame = message and self.decoder.decode(message.arbitration_id, message.data)
            if frame:
                self.latest[frame.name] = frame.signals
                self.counts[frame.name] = self.counts.get(frame.name, 0) + 1

    def states(self, more: int) -> Callable[[], bool]:
        """Hold once that many more system states have come."""
        goal = self.counts.get("SystemState", 0) + more
        return lambda: self.counts.get("SystemState", 0) >= goal


@pytest.fixture
def base() -> Iterator[AgilexBase]:
    with AgilexBase(AgilexSettings(interface="virtual", channel="agilex-test", world="arena")) as base:
        yield base


@pytest.fixture
def host() -> Iterator[Host]:
    with can.Bus(interface="virtual", channel="agilex-test") as bus:
        yield Host(bus)


def standing(base: AgilexBase) -> bool:
    return base.robot.speeds == (0.0, 0.0)


def test_obeys_in_can_mode_only_and_stops_by_itself(base: AgilexBase, host: Host) -> None:
    go = agilex.motion_command(0.2, 0.3)
    host.live(host.states(4), go)
    assert standing(base)
    assert host.latest["SystemState"]["mode"] == agilex.STANDBY
    host.send(agilex.encode("ControlMode", mode=agilex.CAN))
    host.live(lambda: host.latest["MotionState"]["linear"] > 0.198, go)
    assert host.latest["MotionState"]["angular"] == pytest.approx(0.3, abs=2e-3)
    host.live(lambda: host.latest["Odometer"]["left"] > 0.02, go)
    host.live(host.states(1), go)
    assert host.latest["SystemState"]["mode"] == agilex.CAN
    assert host.latest["Odometer"]["right"] > host.latest["Odometer"]["left"]
    assert host.decoder.unknown == host.decoder.rejected == 0
    assert host.counts["MotionState"] > 2 * host.counts["SystemState"]
    host.live(lambda: standing(base))
    last, stop = (max(e.stamp for e in base.events if e.kind == kind) for kind in ("command", "watchdog"))
    assert stop - last >= 500_000_000
    assert base.rest_after(epoch()) is not None


def test_remote_control_and_emergency_stop_override(base: AgilexBase, host: Host) -> None:
    go = agilex.motion_command(0.2, 0.0)
    host.send(agilex.encode("ControlMode", mode=agilex.CAN))
    host.live(lambda: min(base.robot.speeds) > 0.1, go)
    base.remote = True
    host.live(lambda: standing(base), go)
    host.live(host.states(3), go)
    assert standing(base)
    assert host.latest["SystemState"]["mode"] == agilex.REMOTE
    base.remote, base.emergency = False, True
    host.live(host.states(3), go)
    assert standing(base)
    assert host.latest["SystemState"]["vehicle"] == agilex.EMERGENCY_STOP
    base.emergency, base.silent = False, True
    end = time.monotonic() + 0.3
    host.live(lambda: time.monotonic() > end)
    host.counts.clear()
    end = time.monotonic() + 0.3
    host.live(lambda: time.monotonic() > end, go)
    assert host.counts == {}
    assert standing(base)


def test_unknown_bus() -> None:
    with pytest.raises(DriverError, match="CAN bus"):
        AgilexBase(AgilexSettings(interface="socketcan", channel="nosuchcan7", world="arena"))
