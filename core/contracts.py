"""What each kind of plugin must do. The framework calls these; a plugin implements one of them.

A node is built as `impl(context)`, where `context.config` and `context.options` are the validated
models of its manifest. It handles an input port `scan` in a method `on_scan(message)`, gives messages
with `context.emit(port, message)` and never asks the operating system for the time.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from knotwork.core.messages import F64, Message, Scan

Loss = Literal["none", "huber", "cauchy", "geman-mcclure", "welsch"]
Level = Literal["debug", "info", "warning", "error"]


class Context(Protocol):
    """What the runtime gives a node."""

    name: str
    config: Any  # the manifest's config model, validated
    options: Any  # the manifest's options model, validated; None without one
    uses: dict[str, Any]  # nodes by the manifest's use name; an optional one that is absent is None
    out: Path  # the run's folder
    seed: int  # of this node, derived from the run's seed and the node's name
    run: dict[str, Any]  # resolved config, versions, pipeline name: what a log's header needs
    playback: "Playback | None"  # None where the world does not wait (clock real)

    def emit(self, port: str, message: Message) -> None:
        """Give a message on an output port; from another thread it waits in the node's bounded queue."""

    def now(self) -> int:
        """Return the `time` of the event in hand [ns]."""

    def every(self, period: float, call: Callable[[int], None]) -> None:
        """Call `call(time)` each `period` [s] of the run's clock; only before the run starts."""

    def report(self, level: Level, text: str) -> None:
        """Tell a person: one line on the terminal and an `event` message in the log."""

    def count(self, name: str, by: int = 1) -> None:
        """Add to a counter of this node in the summary ("malformed_lines")."""

    def measure(self, name: str = "") -> AbstractContextManager[None]:
        """Time a block under this node's name (or `node.name`) in the summary."""


class Node:
    """Base of all kinds; every method here may be left as it is.

    Order of calls: `__init__`, `warm`, `open`, messages, `stop_motion`, `finish`, `close`.
    """

    def __init__(self, context: Context) -> None:
        self.context = context

    def warm(self) -> None:
        """Compile kernels on tiny inputs; never with a motor's torque on."""

    def open(self) -> None:
        """Open devices and files."""

    def stop_motion(self) -> None:
        """Stop everything that moves; called first when a run ends, also after a failure."""

    def finish(self) -> None:
        """Give last messages: sources have stopped, everything before has been handled, all users have finished."""

    def close(self) -> None:
        """Release devices and files; called once, also after a failure."""

    def statistics(self) -> dict[str, float]:
        """Figures for the summary, asked at its end."""
        return {}


class Driver(Node, ABC):
    """The edge to the world. Pulled (a log, a simulator) or pushing from its own thread (a device)."""

    def events(self) -> Iterator[tuple[str, Message] | int]:
        """Yield `(port, message)` in source order; pulled by the runtime, merged by time with other sources.

        A bare int t [ns] means: nothing comes before t. A simulator yields it before each step and is
        resumed when the run reaches t, so that the commands of the step before have arrived.
        """
        raise NotImplementedError

    def start(self) -> None:
        """Start the thread of a pushing driver; it calls `context.emit`."""
        raise NotImplementedError

    def stop(self) -> None:
        """Stop the thread of a pushing driver."""

    def progress(self) -> float | None:
        """Return the share of the source that has been given, in [0, 1]; None when unknown."""
        return None


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """Gauss-Newton terms of a scan at a pose, in map axes; cost = sum of the loss of whitened residuals.

    The step that lowers the cost is -H^-1 g: `H` (3, 3) and `g` (3,) are sum(w J^T J) and sum(w J^T r)
    with r the residual and J its Jacobian with respect to (x, y, yaw) of the robot pose, both whitened.
    Losses are r^2 near zero, so `g` is half the gradient of `cost`.
    """

    H: F64
    g: F64
    cost: float
    n_used: int  # beams that met the map
    n_total: int  # beams with a return


class Alignment(ABC):
    """One scan prepared for alignment near one guess; poses are (x, y, yaw) of the robot in the map."""

    levels: int  # number of resolutions, 0 the coarsest

    @abstractmethod
    def normal_equations(self, pose: F64, level: int, loss: Loss = "none", scale: float = 1.0) -> NormalEquations:
        """Return H, g and cost at `pose` (3,) in one pass.

        H and g may leave out directions in which a beam knows nothing (along the wall it hit), though the
        cost varies there.
        """

    @abstractmethod
    def costs(self, poses: F64, level: int, loss: Loss = "none", scale: float = 1.0) -> F64:
        """Return the cost at each of `poses` (k, 3): shape (k,)."""

    @abstractmethod
    def residuals(self, pose: F64, level: int) -> tuple[F64, F64]:
        """Return whitened residuals (n,) and their Jacobian (n, 3); for tests."""

    @abstractmethod
    def inliers(self, pose: F64, level: int) -> float:
        """Return the share of beams with a return that the map explains at `pose`, in [0, 1]."""


class Map(Node, ABC):
    """What scans are aligned against and fused into."""

    levels: int

    @abstractmethod
    def alignment(self, scan: Scan, guess: F64, motion: F64 | None = None) -> Alignment:
        """Prepare `scan` near `guess` (3,).

        `motion` (3,) is the robot's twist (vx, vy, yaw rate) in its base frame during the scan: points
        are moved to the scan's stamp by it (de-skewing); None leaves them as measured.
        """

    @abstractmethod
    def update(self, scan: Scan, pose: F64, alignment: Alignment | None = None, fuse: bool = True) -> None:
        """Fuse `scan` taken at robot `pose` (3,); reuses the de-skewed points of `alignment`.

        With `fuse=False` the map stays as it is (localisation only) but may keep book of the scan.
        """

    @abstractmethod
    def empty(self) -> bool:
        """Return True as long as nothing has been fused."""

    @abstractmethod
    def occupancy(self, points: F64) -> F64:
        """Return occupancy at map `points` (n, 2): in [-1, 1], -1 free, 0 unknown, 1 occupied, shape (n,)."""

    @abstractmethod
    def rasterize(self, resolution: float | None = None) -> tuple[NDArray[np.int8], float, tuple[float, float, float]]:
        """Return cells, resolution and origin as in `messages.Grid`."""

    def outlines(self) -> list[F64] | None:
        """Return what the map knows of walls as polylines (n, 2) [m]; None if it holds no lines."""
        return None

    @property
    @abstractmethod
    def nbytes(self) -> int:
        """Memory the map takes [bytes]."""

    @abstractmethod
    def save(self, path: Path) -> None:
        """Write the map to a file with a version and a checksum."""

    @abstractmethod
    def load(self, path: Path) -> None:
        """Replace the map by a file's; raises InputError on a damaged or foreign one."""


@runtime_checkable
class Prior(Protocol):
    """What a localiser asks before it looks at a scan."""

    def prior(self, time: int) -> "PriorEstimate":
        """Return the predicted pose at `time` [ns]: the `stamp` of what was measured, or the run's time."""


@dataclass(frozen=True, slots=True)
class PriorEstimate:
    """Predicted pose of the robot in the map.

    Attributes
    ----------
    pose : shape (3,)
    covariance : shape (3, 3)
        In map axes.
    twist : shape (3,)
        vx, vy [m/s], yaw rate [rad/s] in the base frame, for de-skewing.
    weak
        The prediction may be wrong by more than its covariance says (time gap, discontinuity):
        try several starts.
    ahead
        How far the newest odometry is behind that time [s]: what the robot did since is guessed, and may be
        known soon. 0: it is known, or there is no odometry.
    """

    pose: F64
    covariance: F64
    twist: F64
    weak: bool = False
    ahead: float = 0.0


@runtime_checkable
class PacketSource(Protocol):
    """What a base asks its lidar, from its own thread: no message could tell of a silence in time."""

    def last_packet(self) -> int:
        """Return when the last good packet arrived, by `clock.epoch()` [ns]; 0 before the first."""


class Playback(Protocol):
    """The pace of a replayed or simulated run, for a viewer's thread; the order of events never depends on it."""

    @property
    def paused(self) -> bool:
        """Whether the run stands still."""

    @property
    def rate(self) -> float | None:
        """Speed relative to the sensors'; None: as fast as possible."""

    @rate.setter
    def rate(self, rate: float | None) -> None: ...

    def pause(self) -> None:
        """Stand still after the event in hand."""

    def resume(self) -> None:
        """Go on."""

    def step(self, message_type: str = "") -> None:
        """Go on until a source has given a message of this type ("": any), then stand still again."""


@runtime_checkable
class Stick(Protocol):
    """Where a person's hand is, as a live page offers it to the policy that drives by it."""

    def stick(self) -> tuple[float, float]:
        """Return forward and left, each in [-1, 1]; (0, 0) when nobody holds it or the news of it is too old."""


class Localizer(Node, ABC):
    """Scan + prior + map to `Pose(role="estimate")`."""


class Observer(Node, ABC):
    """Turns streams into estimates."""


class Policy(Node, ABC):
    """State to command."""


class Sink(Node, ABC):
    """Takes messages in its own thread; never slows the estimators, never loses what it accepted."""

    prompt: ClassVar[bool] = False  # True: its thread is woken for each message, at the price of a thread switch

    @abstractmethod
    def on_message(self, stream: str, message: Message) -> None:
        """Take one message of the stream `node.port`."""

    def on_messages(self, messages: Iterator[tuple[str, Message]]) -> None:
        """Take all messages that wait; a sink of many small ones may share a lock or a look-up among them.

        An exception costs the message that was taken last; what is left of `messages` comes with the next call.
        """
        for stream, message in messages:
            self.on_message(stream, message)


class Command(ABC):
    """A subcommand of the command line."""

    @abstractmethod
    def arguments(self, parser: Any) -> None:
        """Add arguments to an `argparse` parser."""

    @abstractmethod
    def run(self, arguments: Any) -> int:
        """Do it; return the exit code."""
