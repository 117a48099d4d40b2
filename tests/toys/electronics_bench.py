"""A line that ends in a list, and a clock that a test moves."""

from collections.abc import Callable

from knotwork.core.emulator.robot import Robot
from knotwork.core.protocols import dynamixel as dxl
from knotwork.core.world.files import load_world
from knotwork.core.world.parameters import BaseParameters

BODY = (
    BaseParameters(wheel_speed_max=0.35, acceleration=4.0, deceleration=4.0).exact().model_copy(update={"ticks": 4096})
)


class FakeLine:
    def __init__(self) -> None:
        self.wire = b""
        self.plugged = True

    def send(self, data: bytes, now: int) -> None:
        self.wire += data


class Bench:
    """A board on a bench: ask it, and let time pass."""

    def __init__(self, make: Callable[[FakeLine, Robot, Callable[..., None]], object]) -> None:
        self.line = FakeLine()
        self.robot = Robot(load_world("arena"), BODY, None, 0, 10**18)
        self.now = 10**18
        self.notes: list[tuple[int, str, dict[str, float]]] = []
        self.board = make(self.line, self.robot, lambda *note: self.notes.append(note))

    def wait(self, seconds: float) -> None:
        end = self.now + round(seconds * 1e9)
        while self.now < end:
            self.now = min(self.now + 1_000_000, end)
            self.robot.advance(self.now)
            self.board.run(self.now)

    def send(self, frame: bytes) -> list[dxl.Packet]:
        """What comes back at once."""
        self.line.wire = b""
        self.board.receive(frame, self.now)
        return self.answers()

    def answers(self) -> list[dxl.Packet]:
        packets = dxl.Parser().feed(self.line.wire)
        self.line.wire = b""
        return packets

    def kinds(self) -> list[str]:
        return [kind for _, kind, _ in self.notes]
