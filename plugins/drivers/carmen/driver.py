"""CARMEN log lines to scans and odometry."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from knotwork.core.contracts import Context
from knotwork.core.log_driver import LogDriver
from knotwork.core.messages import F32, Message, Odometry, Scan
from knotwork.core.stamps import parse_seconds
from knotwork.plugins.drivers.carmen import CarmenConfig

_Pose = tuple[float, float, float]
_Messages = Sequence[tuple[str, Message]]

# CARMEN's convention where a message does not give its angles: beams to step [deg], the first at -90 deg.
_STEP = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5}
_LASERS = (b"FLASER", b"RLASER", b"ROBOTLASER1")

_MOUNT_DIGITS = 4  # a mount is the difference of rounded poses: keep 0.1 mm
_MOUNT_REACH = 2.0  # m; further from the robot's origin there is no sensor
_MOUNT_DRIFT = 0.02  # m and rad a mount may seem to move

_OTHERS = 4  # fields that are not numbers of a message: keyword, timestamp, hostname, logger_timestamp
_FLOAT32 = float(np.finfo(np.float32).max)
_json = msgspec.json.Decoder(list[float])


class CarmenDriver(LogDriver):
    """Streams a CARMEN log; lines of other message types and comments are skipped."""

    expected = "a CARMEN log with FLASER, ROBOTLASER1 or ODOM lines"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._config: CarmenConfig = context.config
        self._laser = b"" if self._config.laser == "auto" else self._config.laser.encode()
        self._mount: _Pose | None = self._config.mount
        self._mount_checked = self._config.mount is not None

    def parse(self, line: bytes) -> _Messages:
        """Return the messages of one line; raises ValueError for a malformed one."""
        first = line.split(None, 1)
        if not first or first[0].startswith(b"#"):
            return ()
        keyword = first[0]
        if keyword == b"ODOM":
            return self._odom(line)
        if keyword in _LASERS:
            if not self._laser and keyword != b"RLASER":
                messages = self._scan(keyword, line)
                self._laser = keyword  # a log may carry the same scan twice, in the old and the new format
                return messages
            if keyword == self._laser:
                return self._scan(keyword, line)
            name = keyword.decode()
            self.remark = f"it has {name} lines, set laser: {name} to use them"
        elif not (keyword.isascii() and keyword.isupper()) or _cut(keyword):
            raise ValueError(f"{_shown(keyword)} is no CARMEN message")
        self.context.count("other_lines")
        return ()

    def _odom(self, line: bytes) -> _Messages:
        # ODOM x y theta tv rv accel ipc_timestamp hostname logger_timestamp
        numbers, stamp = _fields(line)
        _expect(numbers, 6, "ODOM")
        x, y, yaw, tv, rv, _ = _finite(numbers)
        if not self._config.odometry:
            return ()
        pose, twist = np.array((x, y, yaw)), np.array((tv, 0.0, rv))
        return (("odometry", Odometry(stamp=stamp, pose=pose, twist=twist)),)

    def _scan(self, keyword: bytes, line: bytes) -> _Messages:
        angles: tuple[float, float] | None = None
        range_max = self._config.no_return
        intensities: F32 | None = None
        numbers, stamp = _fields(line)
        if keyword == b"ROBOTLASER1":
            # type start_angle field_of_view angular_resolution maximum_range accuracy remission_mode
            # n ranges m remissions laser_pose robot_pose tv rv forward_safety side_safety turn_axis
            # timestamp hostname logger_timestamp
            n, first = _count(numbers, 7), 8
            m = _count(numbers, first + n)
            poses = first + n + 1 + m
            _expect(numbers, poses + 11, f"{n} readings and {m} remissions")
            start, _, step, farthest = numbers[1:5]
            if math.isfinite(start) and 0.0 < step < math.pi:
                angles = start, step
            if farthest > 0.0:
                range_max = min(range_max, farthest)
            if m == n:
                remissions = np.array(numbers[poses - m : poses])
                intensities = remissions.clip(-_FLOAT32, _FLOAT32).astype(np.float32)
        else:
            # n ranges x y theta odom_x odom_y odom_theta ipc_timestamp hostname logger_timestamp
            n, first = _count(numbers, 0), 1
            poses = first + n
            _expect(numbers, poses + 6, f"{n} readings")
        angle_min, angle_increment = self._angles(n, angles)
        sx, sy, syaw, x, y, yaw = _finite(numbers[poses : poses + 6])
        ranges = _ranges(numbers[first : first + n], self._config.range_min, range_max)
        scan = Scan(
            stamp=stamp,
            scan_id=self.scan_id,
            ranges=ranges,
            angle_min=angle_min,
            angle_increment=angle_increment,
            range_min=self._config.range_min,
            range_max=range_max,
            mount=self._mount_of(_relative((x, y, yaw), (sx, sy, syaw))),
            intensities=intensities,
        )
        if not self._config.odometry:
            return (("scan", scan),)
        return (("odometry", Odometry(stamp=stamp, pose=np.array((x, y, yaw)))), ("scan", scan))

    def _angles(self, n: int, message: tuple[float, float] | None) -> tuple[float, float]:
        if message is None and n in _STEP:
            message = -0.5 * math.pi, math.radians(_STEP[n])
        angle_min, angle_increment = self._config.angle_min, self._config.angle_increment
        if message is None and (angle_min is None or angle_increment is None):
            raise ValueError(f"no convention for the angles of {n} beams: set angle_min and angle_increment")
        default = message or (0.0, 0.0)
        return (
            default[0] if angle_min is None else angle_min,
            default[1] if angle_increment is None else angle_increment,
        )

    def _mount_of(self, seen: _Pose) -> _Pose:
        mount = self._mount
        if mount is None:
            mount = _rounded(seen) if math.hypot(seen[0], seen[1]) < _MOUNT_REACH else (0.0, 0.0, 0.0)
            self._mount = mount
        if not self._mount_checked:
            turned = abs(math.remainder(seen[2] - mount[2], math.tau))
            if max(abs(seen[0] - mount[0]), abs(seen[1] - mount[1]), turned) > _MOUNT_DRIFT:
                self._mount_checked = True
                self.context.report(
                    "warning",
                    f"{self._config.path}: the sensor's poses do not fit one place on the robot"
                    f" (a corrected log?); the scans carry mount {list(mount)} (set mount to choose another)",
                )
        return mount


def _fields(line: bytes) -> tuple[list[float], int]:
    """Return the numbers between a line's keyword and its last three fields, and the stamp [ns] of these."""
    parts = line.rsplit(None, 3)
    body = parts[0].split(None, 1)
    if len(parts) < 4 or len(body) < 2:
        raise ValueError("the line is cut off")
    return _numbers(body[1]), parse_seconds(parts[1])


def _numbers(text: bytes) -> list[float]:
    """Return numbers that stand between spaces; read as a JSON list, which is four times faster than one by one."""
    try:
        numbers = _json.decode(b"[%b]" % text.replace(b" ", b","))
        if len(numbers) == text.count(b" ") + 1:
            return numbers
    except msgspec.DecodeError:
        pass  # not written as JSON writes them, or not numbers at all
    return [_number(field) for field in text.split()]


def _number(text: bytes) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{_shown(text)} is not a number") from None


def _ranges(readings: list[float], range_min: float, range_max: float) -> F32:
    values = np.array(readings, np.float64)
    values[values >= range_max] = np.inf
    values[~(values > 0.0) | (values < range_min)] = np.nan  # zero, negative, NaN, too near
    return values.astype(np.float32)


def _relative(robot: _Pose, sensor: _Pose) -> _Pose:
    dx, dy = sensor[0] - robot[0], sensor[1] - robot[1]
    c, s = math.cos(robot[2]), math.sin(robot[2])
    return c * dx + s * dy, c * dy - s * dx, math.remainder(sensor[2] - robot[2], math.tau)


def _rounded(pose: _Pose) -> _Pose:
    x, y, yaw = (round(value, _MOUNT_DIGITS) + 0.0 for value in pose)  # + 0.0: no negative zero
    return x, y, yaw


def _cut(keyword: bytes) -> bool:
    return any(name.startswith(keyword) for name in (*_LASERS, b"ODOM"))


def _count(numbers: list[float], index: int) -> int:
    count = numbers[index] if index < len(numbers) else math.nan
    if not (0.0 <= count < 1e6 and count == int(count)):
        raise ValueError(f"expected a number of readings, found {count:g}")
    return int(count)


def _expect(numbers: list[float], length: int, what: str) -> None:
    if len(numbers) != length:
        raise ValueError(f"{what} make {length + _OTHERS} fields, found {len(numbers) + _OTHERS}")


def _finite(values: list[float]) -> list[float]:
    if not all(map(math.isfinite, values)):
        raise ValueError("a pose is not finite")
    return values


def _shown(text: bytes) -> str:
    return repr(text[:24].decode("ascii", "replace"))
