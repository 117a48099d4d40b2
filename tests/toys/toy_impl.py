"""Implementations of the toy plugins."""

import threading
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from knotwork.core.contracts import Driver, Node, Observer, Sink
from knotwork.core.contracts import Policy as PolicyBase
from knotwork.core.messages import Message, Odometry, Pose, Twist

STEP = 100_000_000  # ns


def twist(stamp: int, vx: float = 0.0) -> Twist:
    return Twist(stamp=stamp, vx=vx)


class Log(Driver):
    def events(self) -> Iterator[tuple[str, Message] | int]:
        for i, stamp in enumerate(self.context.config.stamps):
            yield "out", twist(stamp, float(i))


class Odometer(Driver):
    def events(self) -> Iterator[tuple[str, Message] | int]:
        config = self.context.config
        for k, pose in enumerate(config.poses):
            yield "out", Odometry(stamp=round(k * 1e9 / config.rate), pose=np.array(pose))


class Sim(Driver):
    """x grows by the twist that held over the step; ten steps."""

    def __init__(self, context):
        super().__init__(context)
        self.vx = 0.0

    def on_twist(self, message: Twist) -> None:
        self.vx = message.vx

    def events(self) -> Iterator[tuple[str, Message] | int]:
        x = 0.0
        for step in range(10):
            yield step * STEP
            x += self.vx
            yield "truth", Pose(stamp=step * STEP, role="truth", pose=np.array([x, 0.0, 0.0]))


class Device(Driver):
    """Pushes 20 twists, then asks the run to stop through a class-wide callback."""

    done: ClassVar = staticmethod(lambda: None)

    def start(self) -> None:
        self.thread = threading.Thread(target=self.work)
        self.thread.start()

    def work(self) -> None:
        self.context.report("info", "begun")
        for i in range(20):
            self.context.emit("out", twist(i + 1, float(i)))
        type(self).done()
        self.context.report("warning", "ended")

    def stop(self) -> None:
        self.thread.join()


class Echo(Observer):
    def on_twist(self, message: Twist) -> None:
        self.context.count("seen")
        with self.context.measure("inner"):
            pose = np.array([message.vx, 0.0, 0.0])
        self.context.emit("pose", Pose(stamp=message.stamp, role="estimate", pose=pose))


class Policy(PolicyBase):
    def on_truth(self, message: Pose) -> None:
        self.context.emit("twist", twist(message.stamp, message.pose[0] + 1.0))


class Timer(PolicyBase):
    def __init__(self, context):
        super().__init__(context)
        context.every(context.config.period, self.tick)

    def tick(self, time: int) -> None:
        self.context.emit("twist", twist(time))


class Broken(Observer):
    def on_twist(self, message: Twist) -> None:
        raise ValueError(self.context.config.text)


class Liar(Observer):
    def on_twist(self, message: Twist) -> None:
        self.context.emit("scan", message)


class User(Observer):
    def on_twist(self, message: Twist) -> None:
        self.context.report("info", f"uses {self.context.uses['prior'].context.name}")

    def finish(self) -> None:
        self.context.report("info", f"last use of {self.context.uses['prior'].context.name}")


class Nothing(Node):
    def finish(self) -> None:
        self.context.report("info", f"{self.context.name} finishes")


class Keeper(Sink):
    kept: ClassVar[list[tuple[str, Message]]] = []
    calls: ClassVar[list[str]] = []

    def open(self) -> None:
        type(self).kept = []
        type(self).calls = ["open"]

    def on_message(self, stream: str, message: Message) -> None:
        self.kept.append((stream, message))

    def finish(self) -> None:
        self.calls.append("finish")

    def close(self) -> None:
        self.calls.append("close")


class BadSink(Sink):
    def on_message(self, stream: str, message: Message) -> None:
        raise OSError(28, "No space left on device")
