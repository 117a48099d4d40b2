"""What a sink must do: take every message there is, lose nothing, say clearly when it cannot write."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from knotwork.core.conformance.context import RecordingContext
from knotwork.core.conformance.samples import STEP, core_types, extremes, sample
from knotwork.core.conformance.suite import NodeSuite
from knotwork.core.errors import KnotworkError
from knotwork.core.messages import Message


class SinkSuite(NodeSuite):
    """Checks of sinks."""

    kind = "sink"

    def message(self, port: str, rng: np.random.Generator, number: int, stamp: int) -> Message:
        """Return an ordinary message of an input port; override it for a message type of your own."""
        declared = self.manifest.inputs[port]
        found = sample(declared.message, rng, number, stamp, declared.role)
        if found is None:
            return pytest.fail(f"input {port!r} takes {declared.message!r}: override `message` to make one")
        return found

    def hand(self, context: RecordingContext, node: Any, stream: str, message: Message) -> None:
        """Give a message as the runtime does."""
        context.advance(message.stamp)
        node.on_message(stream, message.sealed(context.time, context.seq))
        context.seq += 1

    def ordinary(self, rounds: int = 25) -> Iterator[tuple[str, Message]]:
        """Yield `(stream, message)`: ordinary messages of what the sink takes."""
        rng = np.random.default_rng(0)
        for number in range(rounds):
            stamp = number * STEP
            for name, port in self.manifest.inputs.items():
                if port.message != "*":
                    yield f"n.{port.message}", self.message(name, rng, number, stamp)
                    continue
                for kind in core_types():
                    message = sample(kind, rng, number, stamp)
                    assert message is not None
                    yield f"n.{kind}", message

    def run(self, context: RecordingContext) -> None:
        """Open a sink, give it ordinary messages, finish and close it."""
        node = self.node(context)
        for stream, message in self.ordinary():
            self.hand(context, node, stream, message)
        node.finish()
        node.close()

    def test_ordinary_messages(self, tmp_path: Path) -> None:
        """It takes them without an error report."""
        context = self.context(tmp_path)
        self.run(context)
        assert not [text for level, text in context.reports if level == "error"]

    def test_extreme_messages(self, tmp_path: Path) -> None:
        """Empty, huge, NaN, infinite, far in time: every valid message of the types it takes."""
        context = self.context(tmp_path)
        node = self.node(context)
        wanted = {port.message for port in self.manifest.inputs.values()}
        for stream, message in extremes():
            if "*" in wanted or message.type_name in wanted:
                self.hand(context, node, stream, message)
        node.finish()
        node.close()

    def test_no_messages(self, tmp_path: Path) -> None:
        """A run may end before its first message."""
        node = self.node(self.context(tmp_path))
        node.finish()
        node.close()

    def test_unwritable_folder(self, tmp_path: Path) -> None:
        """A sink that cannot write says so: a KnotworkError or an error report, when it opens or at the end."""
        context = self.context(tmp_path / "good")
        self.run(context)
        if not any(path.is_file() for path in context.out.rglob("*")):
            pytest.skip("writes no files into the run's folder")
        (tmp_path / "a-file").write_text("not a folder")
        blocked = self.context(tmp_path / "blocked", out=tmp_path / "a-file" / "run")
        node = self.implementation()(blocked)
        said: list[str] = []
        try:
            node.open()
            for stream, message in self.ordinary():
                self.hand(blocked, node, stream, message)
            node.finish()
        except KnotworkError as error:
            said.append(str(error))
        try:
            node.close()
        except KnotworkError as error:
            said.append(str(error))
        said += [text for level, text in blocked.reports if level == "error"]
        assert said, f"kept silent although {blocked.out} cannot exist: what it accepted is lost"
        assert any(str(tmp_path) in text for text in said), f"does not say which file: {said[0]}"
