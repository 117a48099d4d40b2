"""What observers and policies must do with any valid messages on their inputs."""

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from knotwork.core.conformance.context import RecordingContext
from knotwork.core.conformance.samples import STEP, difference, sample
from knotwork.core.conformance.suite import NodeSuite
from knotwork.core.errors import KnotworkError
from knotwork.core.messages import Message, Odometry, Pose, Twist


class StreamSuite(NodeSuite):
    """Feeds a node what its manifest says it takes.

    Attributes
    ----------
    rounds
        Messages a port.
    gives
        The node must emit something from ordinary messages.
    """

    rounds: ClassVar[int] = 120
    gives: ClassVar[bool] = True

    def message(self, port: str, rng: np.random.Generator, number: int, stamp: int) -> Message:
        """Return ordinary message `number` of an input port; override it for a message type of your own."""
        declared = self.manifest.inputs[port]
        found = sample(declared.message, rng, number, stamp, declared.role)
        if found is None:
            return pytest.fail(f"input {port!r} takes {declared.message!r}: override `message` to make one")
        return found

    def feed(self, context: RecordingContext, seed: int = 0, stamps: Any = None) -> Any:
        """Run a node on a mix of all its inputs; returns it, closed."""
        node = self.node(context)
        rng = np.random.default_rng(seed)
        for number in range(self.rounds):
            for offset, port in enumerate(self.manifest.inputs):
                stamp = number * STEP + offset * 1_000_000
                stamp = stamp if stamps is None else stamps(stamp, rng)
                context.give(node, port, self.message(port, rng, number, stamp))
        context.advance(self.rounds * STEP)
        node.stop_motion()
        node.finish()
        node.close()
        return node

    def test_ordinary_messages(self, tmp_path: Path) -> None:
        """The node takes them and gives what it declares, with finite numbers."""
        context = self.context(tmp_path)
        self.feed(context)
        if self.gives and self.manifest.outputs:
            assert context.emitted, "120 messages on each input, and no output"
        for port, message in context.emitted:
            _check_finite(port, message)
            assert type(message.stamp) is int

    def test_same_again(self, tmp_path: Path) -> None:
        """Two instances give the same messages, bit by bit."""
        first, second = self.context(tmp_path / "first"), self.context(tmp_path / "second")
        self.feed(first)
        self.feed(second)
        assert [port for port, _ in first.emitted] == [port for port, _ in second.emitted]
        for (_, a), (_, b) in zip(first.emitted, second.emitted, strict=True):
            assert not difference(a, b), difference(a, b)

    def test_stamps_that_run_backwards(self, tmp_path: Path) -> None:
        """Stamps of real sensors come in bursts, repeat and run backwards."""
        context = self.context(tmp_path)
        self.feed(context, stamps=lambda stamp, rng: max(0, stamp - int(rng.integers(0, 8)) * STEP))
        for port, message in context.emitted:
            _check_finite(port, message)

    def test_one_input_alone(self, tmp_path: Path) -> None:
        """Nothing guarantees that every input has spoken."""
        for port in self.manifest.inputs:
            context = self.context(tmp_path / port)
            node = self.node(context)
            rng = np.random.default_rng(1)
            for number in range(20):
                context.give(node, port, self.message(port, rng, number, number * STEP))
            node.finish()
            node.close()

    def test_nan_does_not_spread(self, tmp_path: Path) -> None:
        """A pose or odometry of NaN is left out or refused with a clear error; no NaN comes out of it."""
        ports = [n for n, p in self.manifest.inputs.items() if p.message in ("odometry", "pose")]
        for port in ports:
            context = self.context(tmp_path / port)
            node = self.node(context)
            rng = np.random.default_rng(2)
            try:
                for number in range(30):
                    for name in self.manifest.inputs:
                        message = self.message(name, rng, number, number * STEP)
                        if name == port and number == 15 and isinstance(message, Odometry | Pose):
                            message = replace(message, pose=np.full(3, np.nan))
                        context.give(node, name, message)
            except KnotworkError:
                continue
            finally:
                node.close()
            for name, message in context.emitted:
                _check_finite(name, message)


class ObserverSuite(StreamSuite):
    """Checks of observers; one that provides a prior is asked for it too."""

    kind = "observer"

    def test_prior(self, tmp_path: Path) -> None:
        """`prior(time)` gives a finite pose, and a covariance that is symmetric and not negative."""
        if "prior" not in self.manifest.provides:
            pytest.skip("does not provide a prior")
        context = self.context(tmp_path)
        node = self.node(context)
        rng = np.random.default_rng(3)
        for number in range(40):
            for port in self.manifest.inputs:
                context.give(node, port, self.message(port, rng, number, number * STEP))
            # At a scan's stamp, which may be behind the run's time; beyond the newest message; long before all.
            for time in (context.now(), context.now() - STEP, context.now() + 10 * STEP, -(10**12)):
                estimate = node.prior(time)
                assert estimate.pose.shape == (3,)
                assert estimate.twist.shape == (3,)
                assert np.all(np.isfinite(estimate.pose))
                assert np.all(np.isfinite(estimate.twist))
                _check_covariance(estimate.covariance)
        node.close()


class PolicySuite(StreamSuite):
    """Checks of policies: commands are finite."""

    kind = "policy"

    def test_commands_are_finite(self, tmp_path: Path) -> None:
        """A command of NaN or infinity must never reach a motor."""
        context = self.context(tmp_path)
        self.feed(context, seed=4)
        for port, message in context.emitted:
            if isinstance(message, Twist):
                assert np.all(np.isfinite([message.vx, message.vy, message.wz])), f"{port}: {message}"


def _check_finite(port: str, message: Message) -> None:
    if isinstance(message, Odometry | Pose):
        assert message.pose.shape == (3,), f"{port}: shape {message.pose.shape}"
        assert np.all(np.isfinite(message.pose)), f"{port}: the pose is {message.pose}"
        if message.covariance is not None:
            _check_covariance(message.covariance)
    if isinstance(message, Twist):
        assert np.all(np.isfinite([message.vx, message.vy, message.wz])), f"{port}: {message}"


def _check_covariance(covariance: np.ndarray[Any, Any]) -> None:
    assert covariance.shape == (3, 3)
    assert np.all(np.isfinite(covariance)), "the covariance is not finite"
    scale = max(float(np.abs(covariance).max()), 1e-300)
    assert np.allclose(covariance, covariance.T, rtol=0, atol=1e-9 * scale), "the covariance is not symmetric"
    assert np.linalg.eigvalsh(covariance).min() >= -1e-9 * scale, "the covariance has a negative direction"
