import os
import struct
import time
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core.messages import MotionState
from knotwork.plugins.policies.teleop_gamepad import Config
from knotwork.plugins.policies.teleop_gamepad.pad import Pad
from knotwork.plugins.policies.teleop_gamepad.policy import TeleopGamepad

HOLD, STOP, REARM = 4, 1, 7


def button(number, pressed=1, initial=False):
    return struct.pack("<IhBB", 1234, pressed, 0x81 if initial else 0x01, number)


def stick(axis, value, initial=False):
    return struct.pack("<IhBB", 1234, value, 0x82 if initial else 0x02, axis)


def test_the_stick_drives_while_the_button_is_held():
    pad = Pad(Config(speed=0.2, yaw_rate=1.0, dead_zone=0.1))
    assert pad.feed(stick(1, -32767) + stick(0, 32767)) == []
    assert pad.command() == (0.0, 0.0)
    pad.feed(button(HOLD))
    assert pad.command() == pytest.approx((0.2, -1.0))
    pad.feed(stick(1, 18022) + stick(0, -3000))  # 0.55 back, within the dead zone left
    assert pad.command() == pytest.approx((-0.1, 0.0), abs=1e-4)
    pad.feed(button(HOLD, 0))
    assert pad.command() == (0.0, 0.0)


def test_after_an_emergency_stop_the_button_must_be_pressed_anew():
    pad = Pad(Config())
    pad.feed(button(HOLD) + stick(1, -32767))
    assert pad.feed(button(STOP) + button(STOP, 0)) == ["stop"]
    assert pad.command() == (0.0, 0.0)
    assert pad.feed(button(REARM) + button(REARM, 0)) == ["rearm"]
    assert pad.command() == (0.0, 0.0)
    pad.feed(button(HOLD, 0) + button(HOLD))
    assert pad.command() == (0.2, 0.0)


def test_what_is_held_when_the_pad_is_opened_does_nothing():
    pad = Pad(Config())
    initial = button(HOLD, initial=True) + button(STOP, initial=True) + button(REARM, initial=True)
    assert pad.feed(initial + stick(1, -32767, initial=True)) == []
    assert pad.command() == (0.0, 0.0)


@given(data=st.binary(max_size=80), cut=st.integers(0, 80))
def test_any_bytes_in_any_pieces_keep_within_the_limits(data, cut):
    whole, parts = Pad(Config()), Pad(Config())
    actions = whole.feed(data)
    assert parts.feed(data[:cut]) + parts.feed(data[cut:]) == actions
    assert parts.command() == whole.command()
    assert abs(whole.command()[0]) <= 0.2
    assert abs(whole.command()[1]) <= 1.0


class Rig:
    """The policy at a named pipe, which ends as a device does when it is unplugged."""

    def __init__(self, path) -> None:
        self.path = path
        self.given: list[tuple[str, object]] = []
        self.lines: list[str] = []
        self.counts: list[str] = []
        self.tick = None
        context = SimpleNamespace(
            config=Config(device=str(path)),
            emit=lambda port, message: self.given.append((port, message)),
            now=lambda: 0,
            every=lambda period, call: setattr(self, "tick", call),
            report=lambda level, text: self.lines.append(text),
            count=self.counts.append,
        )
        self.policy = TeleopGamepad(context)
        self.policy.open()

    def plug(self) -> int:
        os.mkfifo(self.path)
        return os.open(self.path, os.O_WRONLY)  # waits for the reader

    def until(self, condition) -> None:
        give_up = time.monotonic() + 10
        self.tick(0)
        while not condition():
            assert time.monotonic() < give_up, (self.lines, self.given[-3:])
            time.sleep(0.005)
            self.tick(0)

    def last(self, port):
        return next((m for p, m in reversed(self.given) if p == port), None)


@pytest.fixture
def rig(tmp_path):
    rig = Rig(tmp_path / "js0")
    yield rig
    rig.policy.close()


def test_a_pad_is_waited_for_and_its_loss_stops_the_robot(rig):
    rig.until(lambda: any("no gamepad" in line for line in rig.lines))
    assert rig.last("twist").vx == 0.0
    pad = rig.plug()
    os.write(pad, button(HOLD) + stick(1, -32767))
    rig.until(lambda: rig.last("twist").vx == 0.2)
    os.unlink(rig.path)
    os.close(pad)
    rig.until(lambda: rig.last("twist").vx == 0.0 and rig.counts == ["lost"])
    pad = rig.plug()
    os.write(pad, stick(1, -32767))
    rig.until(lambda: sum("gamepad at" in line for line in rig.lines) == 2)
    os.write(pad, button(STOP))
    rig.until(lambda: rig.last("control") is not None)
    assert rig.last("control").action == "stop"
    assert rig.last("twist").vx == 0.0
    os.close(pad)


def test_a_fault_lets_go_and_is_told(rig):
    pad = rig.plug()
    os.write(pad, button(HOLD) + stick(1, -32767))
    rig.until(lambda: rig.last("twist").vx == 0.2)
    rig.policy.on_state(MotionState(stamp=0, state="fault", reason="the lidar is silent"))
    rig.until(lambda: rig.last("twist").vx == 0.0)
    assert any("the lidar is silent" in line for line in rig.lines)
    os.close(pad)
