import os
import time
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core.messages import MotionState
from knotwork.plugins.policies.teleop_keyboard import Config
from knotwork.plugins.policies.teleop_keyboard.keys import Keys, split
from knotwork.plugins.policies.teleop_keyboard.policy import TeleopKeyboard

SECOND = 1_000_000_000


@pytest.fixture
def keys():
    return Keys(Config(speed=0.2, speed_step=0.05, yaw_rate=1.0, yaw_rate_step=0.25, hold=1.0))


def press(keys, text, at=SECOND):
    for key in text:
        keys.press(key, at)
    return keys.command(at)


def test_keys_add_steps_up_to_the_limits(keys):
    assert press(keys, "ww") == (0.1, 0.0)
    assert press(keys, "aaa") == (0.1, 0.75)
    assert press(keys, "wwwwww") == (0.2, 0.75)
    assert press(keys, "d" * 20) == (0.2, -1.0)
    assert press(keys, " ") == (0.0, 0.0)
    assert press(keys, "x" * 20) == (-0.2, 0.0)
    assert press(keys, "wwww") == (0.0, 0.0)  # exactly


def test_a_connection_that_froze_does_not_drive_on(keys):
    assert press(keys, "ww") == (0.1, 0.0)
    assert keys.command(2 * SECOND) == (0.1, 0.0)
    assert keys.command(2 * SECOND + 1) == (0.0, 0.0)
    assert press(keys, "w", 3 * SECOND) == (0.05, 0.0)  # it begins anew


def test_hold_can_be_switched_off():
    keys = Keys(Config(hold=0.0))
    press(keys, "w")
    assert keys.command(10**15) == (0.05, 0.0)


def test_emergency_stop_and_rearm_also_stop(keys):
    press(keys, "ww")
    assert keys.press("e", SECOND) == "stop"
    assert keys.command(SECOND) == (0.0, 0.0)
    press(keys, "ww")
    assert keys.press("r", SECOND) == "rearm"
    assert keys.command(SECOND) == (0.0, 0.0)


@given(text=st.text(max_size=40))
def test_no_key_makes_it_exceed_its_limits(text):
    keys = Keys(Config())
    for key in text:
        keys.press(key, SECOND)
        v, w = keys.command(SECOND)
        assert abs(v) <= 0.2
        assert abs(w) <= 1.0


def test_arrows_are_letters_also_when_they_come_in_pieces():
    assert split(b"w\x1b[A\x1b[D\x1bOCx") == (["w", "w", "a", "d", "x"], b"")
    assert split(b"w\x1b[") == (["w"], b"\x1b[")
    assert split(b"\x1b") == ([], b"\x1b")
    assert split(b"\x1b[5~W") == (["~", "w"], b"")


@given(data=st.binary(max_size=30), cut=st.integers(0, 30))
def test_any_bytes_can_be_split_anywhere(data, cut):
    whole, rest = split(data)
    first, pending = split(data[:cut])
    second, end = split(pending + data[cut:])
    assert (first + second, end) == (whole, rest)


class Terminal:
    """A policy at a pseudo-terminal."""

    def __init__(self, monkeypatch) -> None:
        self.master, slave = os.openpty()
        self.stdin = os.fdopen(slave)
        monkeypatch.setattr("sys.stdin", self.stdin)
        self.given: list[tuple[str, object]] = []
        self.lines: list[str] = []
        self.tick = None
        self.time = SECOND
        context = SimpleNamespace(
            config=Config(),
            emit=lambda port, message: self.given.append((port, message)),
            now=lambda: self.time,
            every=lambda period, call: setattr(self, "tick", call),
            report=lambda level, text: self.lines.append(text),
        )
        self.policy = TeleopKeyboard(context)
        self.policy.open()

    def type(self, data: bytes) -> None:
        os.write(self.master, data)

    def until(self, port: str, what) -> None:
        give_up = time.monotonic() + 10
        while not any(p == port and what(m) for p, m in self.given):
            assert time.monotonic() < give_up, self.given[-3:]
            time.sleep(0.005)
            self.tick(self.time)


@pytest.fixture
def terminal(monkeypatch):
    terminal = Terminal(monkeypatch)
    yield terminal
    terminal.policy.close()
    terminal.stdin.close()


def test_keys_of_the_terminal_become_commands(terminal):
    terminal.type(b"ww")
    terminal.until("twist", lambda m: m.vx == 0.1)
    terminal.type(b"e")
    terminal.until("control", lambda m: m.action == "stop")
    terminal.until("twist", lambda m: m.vx == 0.0)
    terminal.type(b"r")
    terminal.until("control", lambda m: m.action == "rearm")
    os.close(terminal.master)


def test_a_terminal_that_hangs_up_stops_the_robot(terminal):
    terminal.type(b"ww")
    terminal.until("twist", lambda m: m.vx == 0.1)
    os.close(terminal.master)
    terminal.given.clear()
    terminal.until("twist", lambda m: m.vx == 0.0)


def test_the_person_is_told_why_the_robot_stands(terminal):
    terminal.policy.on_state(MotionState(stamp=0, state="fault", reason="the lidar is silent"))
    assert any("the lidar is silent" in line and "r re-arms" in line for line in terminal.lines)
    os.close(terminal.master)


def test_without_a_terminal_the_robot_stands(monkeypatch, tmp_path):
    with open(tmp_path / "file", "w+") as file:
        monkeypatch.setattr("sys.stdin", file)
        lines: list[str] = []
        given: list[object] = []
        context = SimpleNamespace(
            config=Config(),
            emit=lambda port, message: given.append(message),
            now=lambda: 0,
            every=lambda period, call: lines.append(call),
            report=lambda level, text: lines.append(text),
        )
        policy = TeleopKeyboard(context)
        policy.open()
        lines[0](0)
        policy.close()
    assert (given[0].vx, given[0].wz) == (0.0, 0.0)
    assert any("no terminal" in str(line) for line in lines)
