"""The emulated CAN base on python-can's virtual bus."""

import time
from collections.abc import Iterator
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

    def live(self, seconds: float, command: tuple[int, bytes] | None = None) -> None:
        end = time.monotonic() + seconds
        due = 0.0
        while time.monotonic() < end:
            if command and time.monotonic() >= due:
                due = time.monotonic() + agilex.COMMAND_PERIOD
                self.send(command)
            message = self.bus.recv(0.005)
            frame = message and self.decoder.decode(message.arbitration_id, message.data)
            if frame:
                self.latest[frame.name] = frame.signals
                self.counts[frame.name] = self.counts.get(frame.name, 0) + 1


@pytest.fixture
def base() -> Iterator[AgilexBase]:
    with AgilexBase(AgilexSettings(interface="virtual", channel="agilex-test", world="arena")) as base:
        yield base


@pytest.fixture
def host() -> Iterator[Host]:
    with can.Bus(interface="virtual", channel="agilex-test") as bus:
        yield Host(bus)


def test_obeys_in_can_mode_only_and_stops_by_itself(base: AgilexBase, host: Host) -> None:
    go = agilex.motion_command(0.2, 0.3)
    host.live(0.4, go)
    assert base.robot.speeds == (0.0, 0.0)
    assert host.latest["SystemState"]["mode"] == agilex.STANDBY
    host.send(agilex.encode("ControlMode", mode=agilex.CAN))
    host.live(0.8, go)
    assert host.latest["SystemState"]["mode"] == agilex.CAN
    assert host.latest["MotionState"]["linear"] == pytest.approx(0.2, abs=2e-3)
    assert host.latest["MotionState"]["angular"] == pytest.approx(0.3, abs=2e-3)
    assert host.latest["Odometer"]["right"] > host.latest["Odometer"]["left"] > 0.02
    assert host.decoder.unknown == host.decoder.rejected == 0
    assert host.counts["MotionState"] > 3 * host.counts["SystemState"]
    host.live(1.0)
    assert base.robot.speeds == (0.0, 0.0)
    last, stop = (max(e.stamp for e in base.events if e.kind == kind) for kind in ("command", "watchdog"))
    assert stop - last >= 500_000_000
    assert base.rest_after(epoch()) is not None


def test_remote_control_and_emergency_stop_override(base: AgilexBase, host: Host) -> None:
    go = agilex.motion_command(0.2, 0.0)
    host.send(agilex.encode("ControlMode", mode=agilex.CAN))
    host.live(0.4, go)
    assert min(base.robot.speeds) > 0.1
    base.remote = True
    host.live(0.5, go)
    assert base.robot.speeds == (0.0, 0.0)
    assert host.latest["SystemState"]["mode"] == agilex.REMOTE
    base.remote = False
    base.emergency = True
    host.live(0.4, go)
    assert base.robot.speeds == (0.0, 0.0)
    assert host.latest["SystemState"]["vehicle"] == agilex.EMERGENCY_STOP
    base.emergency, base.silent = False, True
    host.live(0.3)
    host.counts.clear()
    host.live(0.3, go)
    assert host.counts == {}


def test_unknown_bus() -> None:
    with pytest.raises(DriverError, match="CAN bus"):
        AgilexBase(AgilexSettings(interface="socketcan", channel="nosuchcan7", world="arena"))
