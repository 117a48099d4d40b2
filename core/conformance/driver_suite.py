"""What a driver must do: declared messages, stamps in nanoseconds, the same ones each time."""

import threading
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from knotwork.core.conformance.context import RecordingContext, check_output
from knotwork.core.conformance.samples import difference
from knotwork.core.conformance.suite import NodeSuite
from knotwork.core.messages import Message, Odometry, Pose, Scan


class DriverSuite(NodeSuite):
    """Checks of drivers.

    Attributes
    ----------
    limit
        So many events are looked at; a log or simulator that goes on is left there.
    patience
        A device must give its first message within this time [s].
    """

    kind = "driver"
    limit: ClassVar[int] = 500
    patience: ClassVar[float] = 10.0

    def collect(self, context: RecordingContext) -> tuple[Any, list[tuple[str, Message]]]:
        """Run a driver to its end or `limit`; return it, closed, and what it gave."""
        if self.manifest.push:
            return self._pushed(context)
        node = self.node(context)
        given: list[tuple[str, Message]] = []
        time = -(2**63)
        source = iter(node.events())
        for _ in range(self.limit):
            item = next(source, None)
            if item is None:
                break
            if isinstance(item, int):
                time = max(time, item)
            else:
                given.append(item)
                time = max(time, item[1].stamp)
            context.time = time
        share = node.progress()
        assert share is None or 0.0 <= share <= 1.0, f"progress() is {share}"
        self._end(node)
        return node, given

    def _pushed(self, context: RecordingContext) -> tuple[Any, list[tuple[str, Message]]]:
        enough = threading.Event()
        emit = context.emit

        def watched(port: str, message: Message) -> None:
            emit(port, message)
            if len(context.emitted) >= min(self.limit, 20):
                enough.set()

        context.emit = watched  # type: ignore[method-assign]
        node = self.node(context)
        node.start()
        enough.wait(self.patience)
        node.stop_motion()
        node.stop()
        context.emit = emit  # type: ignore[method-assign]
        count = len(context.emitted)
        node.finish()
        node.close()
        assert count, f"no message within {self.patience} s"
        return node, list(context.emitted)

    @staticmethod
    def _end(node: Any) -> None:
        node.stop_motion()
        node.finish()
        node.close()

    def test_gives_declared_messages(self, tmp_path: Path) -> None:
        """Every message is of a declared port's type and role, with an integer stamp."""
        context = self.context(tmp_path)
        _, given = self.collect(context)
        assert given, "the driver gave nothing"
        for port, message in given:
            check_output(context.manifest, "driver", port, message)
            assert type(message.stamp) is int, f"{port}: the stamp is {type(message.stamp).__name__}, not int [ns]"

    def test_messages_make_sense(self, tmp_path: Path) -> None:
        """Scans are numbered without gaps and hold float32; poses are finite and of shape (3,)."""
        _, given = self.collect(self.context(tmp_path))
        numbers: dict[str, int] = {}
        for port, message in given:
            if isinstance(message, Scan):
                assert message.scan_id == numbers.get(port, 0), f"{port}: scan_id {message.scan_id} is out of turn"
                numbers[port] = message.scan_id + 1
                assert message.ranges.dtype == np.float32
                assert message.ranges.ndim == 1
                assert 0 <= message.range_min < message.range_max
                assert message.angle_increment != 0
                finite = message.ranges[np.isfinite(message.ranges)]
                assert np.all(finite >= 0), f"{port}: negative ranges; an invalid reading is NaN"
            if isinstance(message, Odometry | Pose):
                assert message.pose.shape == (3,)
                assert np.all(np.isfinite(message.pose)), f"{port}: the pose is {message.pose}"

    def test_same_again(self, tmp_path: Path) -> None:
        """Two instances of the same config and seed give the same messages, bit by bit."""
        if self.manifest.push:
            pytest.skip("a device does not repeat itself")
        _, first = self.collect(self.context(tmp_path / "first"))
        _, second = self.collect(self.context(tmp_path / "second"))
        assert [port for port, _ in first] == [port for port, _ in second]
        for number, ((_, a), (_, b)) in enumerate(zip(first, second, strict=True)):
            assert not difference(a, b), f"message {number}: {difference(a, b)}"
