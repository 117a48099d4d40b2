"""The messages that streams carry: frozen, typed, SI units, right-handed frames, integer nanoseconds.

Every message has `stamp` (measurement time as its source gives it), `time` (monotone within the run,
set by the dispatcher) and `seq` (dispatch number, set by the dispatcher). Arrays become read-only.
A third party adds a type by subclassing `Message`; `knotwork.core.codec` then logs and replays it.
"""

from dataclasses import dataclass, fields
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
I64 = NDArray[np.int64]

UNSET = -1  # `time` and `seq` of a message that has not been dispatched yet

Role = Literal["prior", "estimate", "truth"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Message:
    """What every message has.

    Attributes
    ----------
    stamp
        Measurement time as its source gives it [ns]. May run backwards; never sort by it.
    time
        Running maximum of the stamps of the run [ns]; drives clock, timers and log order.
    seq
        Dispatch number within the run.
    """

    type_name: ClassVar[str] = ""

    stamp: int
    time: int = UNSET
    seq: int = UNSET

    def __post_init__(self) -> None:
        for field in _array_fields(type(self)):
            value = getattr(self, field)
            if value is not None and value.flags.writeable:
                view = value.view()
                view.flags.writeable = False
                object.__setattr__(self, field, view)

    def sealed(self, time: int, seq: int) -> Self:
        """Return this message with its dispatch `time` and `seq`; only the dispatcher calls this."""
        out = self if self.seq == UNSET else self.copy()
        object.__setattr__(out, "time", time)
        object.__setattr__(out, "seq", seq)
        return out

    @property
    def nbytes(self) -> int:
        """Bytes of its arrays and files: what makes one message larger than another."""
        total = 0
        for name in _heavy_fields(type(self)):
            value = getattr(self, name)
            if value is not None:
                total += len(value) if isinstance(value, bytes) else value.nbytes
        return total

    def copy(self) -> Self:
        """Shallow copy (arrays are read-only and shared)."""
        return type(self)(**{f.name: getattr(self, f.name) for f in fields(self)})


_ARRAY_FIELDS: dict[type, tuple[str, ...]] = {}


def _array_fields(cls: type[Message]) -> tuple[str, ...]:
    names = _ARRAY_FIELDS.get(cls)
    if names is None:
        names = tuple(f.name for f in fields(cls) if "NDArray" in str(f.type) or "ndarray" in str(f.type))
        _ARRAY_FIELDS[cls] = names
    return names


_HEAVY_FIELDS: dict[type, tuple[str, ...]] = {}


def _heavy_fields(cls: type[Message]) -> tuple[str, ...]:
    names = _HEAVY_FIELDS.get(cls)
    if names is None:
        files = tuple(f.name for f in fields(cls) if f.type in (bytes, "bytes"))
        names = _HEAVY_FIELDS[cls] = _array_fields(cls) + files
    return names


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scan(Message):
    """One turn of a planar range sensor, beams counter-clockwise.

    Attributes
    ----------
    scan_id
        Number of the scan within its stream, from 0, without gaps.
    ranges : float32, shape (n,)
        Metres in the sensor frame; `inf` is "no return" (free up to `range_max`), NaN is "invalid".
    angle_min, angle_increment
        Beam i points at `angle_min + i * angle_increment` [rad] in the sensor frame.
    range_min, range_max
        What the sensor can measure [m].
    mount
        Pose of the sensor in the robot's base frame: x [m], y [m], yaw [rad].
    time_offset, time_increment
        Beam i was measured at `stamp + time_offset + i * time_increment` [s]; a clockwise sensor has
        a negative increment. Both 0: all beams at once.
    intensities : float32, shape (n,), or None
    frame
        Name of the sensor frame.
    """

    type_name: ClassVar[str] = "scan"

    scan_id: int
    ranges: F32
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    time_offset: float = 0.0
    time_increment: float = 0.0
    intensities: F32 | None = None
    frame: str = "laser"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Odometry(Message):
    """Pose of `base` in the continuous, drifting `odom` frame; never jumps unless it says so.

    Attributes
    ----------
    pose : shape (3,)
        x [m], y [m], yaw [rad].
    twist : shape (3,) or None
        vx, vy [m/s], yaw rate [rad/s] in the base frame.
    covariance : shape (3, 3) or None
        Of the motion since the previous message, in the frame of the previous pose.
    discontinuity
        The pose cannot be compared with the previous message's (reconnect, counter reset).
    """

    type_name: ClassVar[str] = "odometry"

    pose: F64
    twist: F64 | None = None
    covariance: F64 | None = None
    discontinuity: bool = False
    frame: str = "odom"
    child: str = "base"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pose(Message):
    """A pose of `base` in `map`: a prior, an estimate or the truth.

    Attributes
    ----------
    role
        What kind of statement this is; wires are inferred by it.
    pose : shape (3,)
        x [m], y [m], yaw [rad].
    covariance : shape (3, 3) or None
        Of `pose`, prior included, in map axes [m^2, m rad, rad^2].
    scan_id
        The scan this pose belongs to, -1 for none.
    quality
        Share of the scan that the map explains, in [0, 1]; NaN when unknown.
    lost
        The localiser does not believe this pose; nothing may be fused at it.
    revision
        Grows when an earlier pose is superseded (loop closure).
    scan_pose, scan_information : shape (3,), shape (3, 3), or None
        What the scan alone says: a Gaussian of that mean and information, the prior taken out. The
        information may be singular (a featureless corridor).
    prior_included
        True: a filter replaces its state by `pose`, `local_covariance`. False: it corrects with them.
    local_covariance : shape (3, 3) or None
        Of `pose` relative to the part of the map around it, prior included: what the next scan's prior
        needs. None: `covariance` serves.
    """

    type_name: ClassVar[str] = "pose"

    role: Role
    pose: F64
    covariance: F64 | None = None
    scan_id: int = -1
    quality: float = float("nan")
    lost: bool = False
    revision: int = 0
    scan_pose: F64 | None = None
    scan_information: F64 | None = None
    prior_included: bool = False
    local_covariance: F64 | None = None
    frame: str = "map"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory(Message):
    """Poses of many scans; supersedes earlier `Pose` messages of lower revision.

    Attributes
    ----------
    scan_ids : int64, shape (n,)
    stamps : int64, shape (n,)
    poses : shape (n, 3)
    """

    type_name: ClassVar[str] = "trajectory"

    scan_ids: I64
    stamps: I64
    poses: F64
    revision: int = 0
    frame: str = "map"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Transform(Message):
    """Pose of frame `child` in frame `parent`: x [m], y [m], yaw [rad]. `map` to `odom` may jump."""

    type_name: ClassVar[str] = "transform"

    parent: str
    child: str
    pose: F64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Twist(Message):
    """Commanded velocity of `base`: vx, vy [m/s], yaw rate [rad/s].

    `stamp` is the run's time at its emission (`context.now()`); a base counts its age from there.
    """

    type_name: ClassVar[str] = "twist"

    vx: float
    vy: float = 0.0
    wz: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotionControl(Message):
    """What a person tells a base: emergency `stop`, or `rearm` after a fault or an emergency stop."""

    type_name: ClassVar[str] = "motion_control"

    action: Literal["stop", "rearm"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotionState(Message):
    """Whether a base may move, given at each change.

    Attributes
    ----------
    state
        `ready`; `waiting` for first data; `fault` or `emergency`: it stands until re-armed.
    reason
        Why it stands, "" when it need not.
    """

    type_name: ClassVar[str] = "motion_state"

    state: Literal["ready", "waiting", "fault", "emergency"]
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraTwist(Message):
    """Commanded velocity of a camera in its optical frame: `v` (3,) [m/s], `w` (3,) [rad/s]."""

    type_name: ClassVar[str] = "camera_twist"

    v: F64
    w: F64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Imu(Message):
    """Inertial measurement in the base frame.

    Attributes
    ----------
    angular_velocity : shape (3,) [rad/s]
    linear_acceleration : shape (3,) [m/s^2]
    orientation_wxyz : shape (4,) or None
    """

    type_name: ClassVar[str] = "imu"

    angular_velocity: F64
    linear_acceleration: F64
    orientation_wxyz: F64 | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wheels(Message):
    """Encoders: `angle` (k,) [rad, since the start], `velocity` (k,) [rad/s]; left first."""

    type_name: ClassVar[str] = "wheels"

    angle: F64
    velocity: F64
    discontinuity: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Battery(Message):
    """Supply voltage [V], charge in [0, 1] (NaN when unknown)."""

    type_name: ClassVar[str] = "battery"

    voltage: float
    charge: float = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid(Message):
    """A raster of a map, for pictures, viewers and planners.

    Attributes
    ----------
    cells : int8, shape (rows, cols)
        Occupancy probability in percent, 0 free to 100 occupied, -1 unknown; row 0 is the lowest y.
    resolution
        Side of a cell [m].
    origin
        Pose of the lower left corner of cell (0, 0) in `frame`: x [m], y [m], yaw [rad].
    map_bytes
        Memory the map itself takes [bytes].
    final
        The last one of the run.
    """

    type_name: ClassVar[str] = "grid"

    cells: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float, float]
    map_bytes: int = 0
    final: bool = False
    frame: str = "map"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Image(Message):
    """An image: `data` is the file's bytes for `encoding` "jpeg"/"png", else raw pixels row by row."""

    type_name: ClassVar[str] = "image"

    data: bytes
    encoding: str
    width: int
    height: int
    frame: str = "camera"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Features(Message):
    """Tracked points: `ids` (n,), normalised image coordinates `points` (n, 2)."""

    type_name: ClassVar[str] = "features"

    ids: I64
    points: F64
    frame: str = "camera"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Depths(Message):
    """Inverse depths of image points, as an observer estimates them or as they truly are.

    Attributes
    ----------
    ids, points : shape (n,), shape (n, 2)
        The features, as measured (normalised image coordinates).
    chi : shape (n,)
        Inverse depths [1/m].
    variance : shape (n,) or None
        Of `chi` [1/m^2].
    sigma2 : shape (n,) or None
        Excitation sigma^2 over the last step [m^2/s^2]: how much the motion says about each depth.
    uncertainty : shape (n,) or None
        Windowed mean of the squared image residual (9.41); infinite until the window is full.
    conditions : bool, shape (n, 3), or None
        Which conditions of convergence (Theorem 8.2) held over the last step: v_z <= 0, J_l w <= 0,
        sigma^2 large enough.
    condition : shape (n,) or None
        Condition number of the geometry that gave each depth (triangulation); infinite: no depth, chi is NaN.
    """

    type_name: ClassVar[str] = "depths"

    ids: I64
    points: F64
    chi: F64
    variance: F64 | None = None
    sigma2: F64 | None = None
    uncertainty: F64 | None = None
    conditions: NDArray[np.bool_] | None = None
    condition: F64 | None = None
    role: Role = "estimate"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraPose(Message):
    """Pose of a camera: `position` (3,) [m] and `rotation` (3, 3), its optical axes as columns, in `frame`."""

    type_name: ClassVar[str] = "camera_pose"

    role: Role
    position: F64
    rotation: F64
    frame: str = "world"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ServoState(Message):
    """What a vision policy is doing.

    Attributes
    ----------
    phase
        1: no point is certain yet; 2: some are; 3: all are, nothing is constrained.
    error
        Norm of the stacked image error (2n,).
    ids, certainty : shape (n,)
        The points it servoes, and how certain their depths are in [0, 1].
    exciting
        The camera is being kept in motion for the sake of the depths.
    solved
        The command is the solution; False: a safe stop.
    """

    type_name: ClassVar[str] = "servo_state"

    phase: int
    error: float
    ids: I64
    certainty: F64
    exciting: bool = False
    solved: bool = True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Event(Message):
    """Something a person should know: a warning, a reconnect, a lost pose, a malformed line."""

    type_name: ClassVar[str] = "event"

    node: str
    level: Literal["debug", "info", "warning", "error"]
    text: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Statistics(Message):
    """What the runtime measured: per node counts, times and drops; wall-clock, so never compared."""

    type_name: ClassVar[str] = "statistics"

    data: dict[str, Any]
    final: bool = False
