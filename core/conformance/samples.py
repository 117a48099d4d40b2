"""Messages to try plugins with: ordinary ones of every type, and extreme ones that are still valid."""

import math
from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.random import Generator

from knotwork.core import messages as m
from knotwork.core.conformance.room import Room, scan_of

STEP = 50_000_000  # ns between messages
_ROOM = Room()


def sample(name: str, rng: Generator, number: int, stamp: int, role: str = "") -> m.Message | None:
    """Return message `number` of a stream of the core type `name`; None for a type that core does not know."""
    make = _ORDINARY.get(name)
    if make is None:
        return None
    message = make(rng, number, stamp)
    if role and isinstance(message, m.Pose):
        return _pose(rng, number, stamp, role)
    return message


def _path(number: int) -> m.F64:
    """Return the robot's pose at message `number`: a circle of 1 m at 0.2 m/s."""
    angle = 0.2 * number * STEP / 1e9
    return np.array([math.sin(angle), 1.0 - math.cos(angle), math.remainder(angle, 2 * math.pi)])


def _scan(rng: Generator, number: int, stamp: int) -> m.Scan:
    ranges = _ROOM.ranges(_path(number) - [0.0, 1.0, 0.0], np.linspace(-math.pi, math.pi, 90))
    ranges[rng.integers(0, 90, 5)] = math.nan
    ranges[rng.integers(0, 90, 5)] = math.inf
    return scan_of(ranges + rng.normal(0, 0.01, 90), stamp=stamp, scan_id=number)


def _odometry(rng: Generator, number: int, stamp: int) -> m.Odometry:
    noise = rng.normal(0, 1e-3, 3)
    twist = np.array([0.2, 0.0, 0.2]) if number % 3 else None
    return m.Odometry(stamp=stamp, pose=_path(number) + noise, twist=twist, discontinuity=number % 17 == 16)


def _pose(rng: Generator, number: int, stamp: int, role: str = "estimate") -> m.Pose:
    return m.Pose(
        stamp=stamp, role=role, pose=_path(number) + rng.normal(0, 1e-2, 3),  # type: ignore[arg-type]
        covariance=np.diag([1e-4, 1e-4, 1e-5]), scan_id=number, lost=number % 13 == 12,
        quality=math.nan if number % 5 == 4 else float(rng.uniform()), prior_included=number % 2 == 0,
    )  # fmt: skip


def _features(rng: Generator, number: int, stamp: int) -> m.Features:
    n = int(rng.integers(0, 20))
    return m.Features(stamp=stamp, ids=np.arange(n, dtype=np.int64), points=rng.uniform(-0.5, 0.5, (n, 2)))


def _depths(rng: Generator, number: int, stamp: int) -> m.Depths:
    n = int(rng.integers(0, 20))
    return m.Depths(
        stamp=stamp, ids=np.arange(n, dtype=np.int64), points=rng.uniform(-0.5, 0.5, (n, 2)),
        chi=rng.uniform(0.1, 2, n), variance=rng.uniform(0, 1, n),
    )  # fmt: skip


_ORDINARY: dict[str, Callable[[Generator, int, int], m.Message]] = {
    "scan": _scan,
    "odometry": _odometry,
    "pose": _pose,
    "trajectory": lambda rng, n, t: m.Trajectory(
        stamp=t, scan_ids=np.arange(3), stamps=t + STEP * np.arange(3), poses=rng.normal(size=(3, 3)), revision=n
    ),
    "transform": lambda rng, n, t: m.Transform(stamp=t, parent="map", child="odom", pose=rng.normal(size=3)),
    "twist": lambda rng, n, t: m.Twist(stamp=t, vx=float(rng.uniform(-0.2, 0.2)), wz=float(rng.uniform(-1, 1))),
    "motion_control": lambda rng, n, t: m.MotionControl(stamp=t, action=("stop", "rearm")[n % 2]),
    "camera_pose": lambda rng, n, t: m.CameraPose(
        stamp=t, role="truth", position=rng.normal(size=3), rotation=np.eye(3)
    ),
    "servo_state": lambda rng, n, t: m.ServoState(
        stamp=t, phase=n % 3 + 1, error=0.1, ids=np.arange(4), certainty=rng.uniform(size=4)
    ),
    "motion_state": lambda rng, n, t: m.MotionState(
        stamp=t, state=("waiting", "ready", "fault", "emergency")[n % 4], reason="" if n % 4 == 1 else "a reason"
    ),
    "camera_twist": lambda rng, n, t: m.CameraTwist(stamp=t, v=rng.normal(size=3), w=rng.normal(size=3)),
    "imu": lambda rng, n, t: m.Imu(
        stamp=t, angular_velocity=rng.normal(size=3), linear_acceleration=rng.normal(size=3)
    ),
    "wheels": lambda rng, n, t: m.Wheels(stamp=t, angle=0.3 * n + np.zeros(2), velocity=rng.normal(6, 0.1, 2)),
    "battery": lambda rng, n, t: m.Battery(stamp=t, voltage=12.0 - 1e-3 * n),
    "grid": lambda rng, n, t: m.Grid(
        stamp=t, cells=rng.integers(-1, 101, (7, 9)).astype(np.int8), resolution=0.05, origin=(-1.0, 2.0, 0.0)
    ),
    "image": lambda rng, n, t: m.Image(stamp=t, data=rng.bytes(48), encoding="rgb8", width=4, height=4),
    "features": _features,
    "depths": _depths,
    "event": lambda rng, n, t: m.Event(stamp=t, node="node", level="info", text=f"line {n}"),
    "statistics": lambda rng, n, t: m.Statistics(stamp=t, data={"wall_s": 0.1 * n, "nodes": {}, "counters": {}}),
}  # fmt: skip


def core_types() -> list[str]:
    """Return the names of the core's message types."""
    return list(_ORDINARY)


def extremes() -> Iterator[tuple[str, m.Message]]:
    """Yield `(stream, message)`: every core type at the ends of what it may hold, times growing."""
    empty = np.empty(0)
    nan3 = np.full(3, math.nan)
    far = (1 << 62) - 1
    text = 'käse "\\\n\x00 \U0001f916 ' + "x" * 5000
    yield "a.scan", scan_of([], scan_id=0)
    yield "a.scan", scan_of([math.nan, math.inf, 0.0, -1.0, 1e30], scan_id=1)
    yield "a.scan", scan_of(np.full(100_000, 1.0), scan_id=2)
    yield "a.odometry", m.Odometry(stamp=0, pose=nan3, twist=nan3, covariance=np.full((3, 3), math.inf))
    for role in ("prior", "estimate", "truth"):
        yield f"b.{role}", m.Pose(stamp=0, role=role, pose=np.array([1e300, -1e-300, math.inf]), lost=True)
        yield f"b.{role}", m.Pose(stamp=1, role=role, pose=nan3, covariance=np.full((3, 3), math.nan), scan_id=1 << 40)
        yield f"b.{role}", m.Pose(stamp=2, role=role, pose=np.zeros(3), scan_id=0, revision=1 << 40)
    yield (
        "b.path",
        m.Trajectory(stamp=3, scan_ids=np.empty(0, np.int64), stamps=np.empty(0, np.int64), poses=np.empty((0, 3))),
    )
    yield "c.tf", m.Transform(stamp=4, parent="", child=text, pose=nan3)
    yield "c.motion_control", m.MotionControl(stamp=5, action="stop")
    yield "c.motion_state", m.MotionState(stamp=5, state="fault", reason=text)
    yield "c.twist", m.Twist(stamp=5, vx=math.inf, vy=-math.inf, wz=math.nan)
    yield "c.pose", m.CameraPose(stamp=6, role="estimate", position=nan3, rotation=np.full((3, 3), math.nan))
    yield "c.servo", m.ServoState(stamp=6, phase=0, error=math.nan, ids=np.empty(0, np.int64), certainty=empty)
    yield "c.camera", m.CameraTwist(stamp=6, v=nan3, w=np.array([1e308, -0.0, 5e-324]))
    yield "c.imu", m.Imu(stamp=7, angular_velocity=nan3, linear_acceleration=nan3, orientation_wxyz=np.zeros(4))
    yield "c.wheels", m.Wheels(stamp=8, angle=empty, velocity=empty, discontinuity=True)
    yield "c.battery", m.Battery(stamp=9, voltage=math.nan)
    yield "d.grid", m.Grid(stamp=10, cells=np.empty((0, 0), np.int8), resolution=0.05, origin=(0.0, 0.0, 0.0))
    yield (
        "d.grid",
        m.Grid(
            stamp=11,
            cells=np.full((1, 1), -1, np.int8),
            resolution=1e-6,
            origin=(1e6, -1e6, 3.0),
            map_bytes=1 << 50,
            final=True,
        ),
    )
    yield "e.image", m.Image(stamp=12, data=b"", encoding="jpeg", width=0, height=0)
    yield "e.features", m.Features(stamp=13, ids=np.empty(0, np.int64), points=np.empty((0, 2)))
    yield (
        "e.depths",
        m.Depths(stamp=14, ids=np.array([1 << 62]), points=np.full((1, 2), math.nan), chi=np.array([math.inf])),
    )
    yield "f.events", m.Event(stamp=15, node="", level="error", text=text)
    yield "f.statistics", m.Statistics(stamp=16, data={})
    yield "a.scan", scan_of([1.0], stamp=far, scan_id=3)


def difference(a: m.Message, b: m.Message) -> str:
    """Return the first field in which two messages differ ("" for none); NaN equals NaN, arrays bit by bit."""
    if type(a) is not type(b):
        return f"{type(a).__name__} and {type(b).__name__}"
    for f in fields(a):
        if not _same(getattr(a, f.name), getattr(b, f.name)):
            return f"{a.type_name}.{f.name}: {getattr(a, f.name)!r} and {getattr(b, f.name)!r}"
    return ""


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if isinstance(a, float) and isinstance(b, float):
        return a == b or (math.isnan(a) and math.isnan(b))
    return bool(type(a) is type(b) and a == b)
