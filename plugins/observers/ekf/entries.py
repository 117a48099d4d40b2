"""What the filter remembers: odometry (or scans, without it), corrections, and the state after each."""

from typing import Literal, NamedTuple, TypeAlias

from knotwork.core.geometry import IDENTITY, Pose2
from knotwork.core.messages import F64
from knotwork.plugins.observers.ekf.filter import Triangle

Outcome: TypeAlias = Literal["taken", "refused", "forced"]
Place: TypeAlias = tuple[int, int]  # time [ns] and knot number
Key: TypeAlias = tuple[int, int, int, int, int]  # time, knot number, 1 for a correction, stamp, scan id


class Steady(NamedTuple):
    """Motion from scan to scan, for a robot without odometry."""

    step: Pose2 | None = None  # body twist per scan [m, m, rad]; None before the second correction
    last: Pose2 | None = None  # pose of the last correction
    scans: int = 0  # since then
    period: float = 0.0  # mean time from scan to scan [s]


class State(NamedTuple):
    """The filter's state after an entry; map axes."""

    pose: Pose2
    covariance: Triangle
    moved: float = 0.0  # way since the last correction [m]
    turned: float = 0.0  # turning since the last correction [rad]
    weak: bool = False
    refused: int = 0  # corrections refused in a row
    steady: Steady = Steady()


class Knot:
    """An odometry message, or a scan of a robot without odometry (`odom` is None)."""

    __slots__ = ("covariance", "gap", "jump", "key", "number", "odom", "state", "time", "twist")

    part = 0.0  # how far into the interval to the next knot; a correction has its own

    def __init__(self, time: int, number: int, odom: Pose2 | None, state: State) -> None:
        self.time = time
        self.number = number
        self.key: Key = (time, number, 0, 0, 0)
        self.odom = odom
        self.state = state
        self.twist: Pose2 = IDENTITY  # body twist on the way to this knot [m/s, m/s, rad/s]
        self.covariance: Triangle | None = None  # of the motion since the last knot, as its source states it
        self.jump = False  # the motion since the last knot is unknown
        self.gap = False  # the motion since the last knot is large and went over a gap in time


class Fix:
    """A correction, placed after the knot `number`."""

    __slots__ = (
        *("key", "time", "number", "pose", "covariance", "information", "replace"),
        *("odom", "part", "outcome", "state"),
    )

    def __init__(self, key: Key, pose: Pose2, covariance: Triangle, information: F64 | None, replace: bool) -> None:
        self.key = key
        self.time = key[0]
        self.number = key[1]
        self.pose = pose
        self.covariance = covariance
        self.information = information  # instead of the covariance; may be singular
        self.replace = replace
        self.odom: Pose2 | None = None  # odometry at this time, interpolated
        self.part = 0.0
        self.outcome: Outcome = "taken"
        self.state = State(pose, (0.0,) * 6)


Entry: TypeAlias = Knot | Fix
