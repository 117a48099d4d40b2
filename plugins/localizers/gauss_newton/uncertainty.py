"""How uncertain a pose is in the map's frame: as uncertain as the part of the map it was aligned with.

A scan says where the robot is relative to what it sees. What it sees was drawn into the map from poses that
were themselves uncertain, so each cell remembers the covariance of the pose from which it was first seen.
The errors of prior and map are taken as fully correlated, which never claims too much: along a featureless
corridor the covariance grows with odometry's, on return to an old place it falls back to that place's.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.kernel import inlined, kernel
from knotwork.core.messages import F64, Scan

Array = NDArray[Any]

_CELL = 0.5  # m
_BEAMS = 32  # of a scan that are looked up
_FREE = np.int64(-(2**63))  # key of an empty slot


class MapUncertainty:
    """Covariance of the robot's pose in the map, (x, y, yaw) in map axes.

    Parameters
    ----------
    inflation
        Variance of a scan's pose relative to that of independent beams.
    """

    def __init__(self, inflation: float) -> None:
        self.covariance = np.zeros((3, 3))
        self._inflation = inflation
        self._pose = np.zeros(3)
        self._local = np.zeros((3, 3))
        self._keys = np.full(1024, _FREE)
        self._records = np.empty((1024, 11))  # pose x, y, covariance
        self._known = 0

    def warm(self) -> None:
        """Compile the kernels."""
        scan = Scan(
            stamp=0, scan_id=0, ranges=np.ones(1, np.float32), angle_min=0.0, angle_increment=1.0,
            range_min=0.0, range_max=2.0,
        )  # fmt: skip
        pose, unit = np.zeros(3), np.eye(3)
        scan_alone(pose, unit, np.zeros(3), np.eye(3), np.empty((3, 3)), np.empty(3))
        self.follow(scan, pose, unit, unit, unit, unit)
        self.remember(scan, pose)
        self._grow(2048)

    def begin(self, pose: F64, covariance: F64) -> None:
        """Start at a pose (3,) of covariance (3, 3)."""
        self._pose = pose
        self.covariance = covariance.copy()
        self._local = covariance

    def follow(self, scan: Scan, pose: F64, prior: F64, information: F64, H: F64, local: F64) -> F64:
        """Return the covariance (3, 3) of the posterior `pose` (3,).

        Parameters
        ----------
        prior : shape (3, 3)
            Covariance of the prior relative to the map around it.
        information, H : shape (3, 3)
            Of the prior as it was used, and of the scan.
        local : shape (3, 3)
            Covariance of the posterior relative to the map around it.
        """
        out = np.empty((3, 3))
        posterior_in_map(
            self._keys, self._records, scan.ranges, scan.angle_min, scan.angle_increment, scan.range_max,
            scan.mount[0], scan.mount[1], scan.mount[2], pose, self._pose, self.covariance, self._local, prior,
            information, H, self._inflation, out,
        )  # fmt: skip
        self._pose = pose
        self._local = local
        self.covariance = out
        return out

    def remember(self, scan: Scan, pose: F64) -> None:
        """Note that what `scan` sees was drawn into the map from `pose` (3,)."""
        if 2 * (self._known + len(scan.ranges)) > len(self._keys):
            self._grow(4 * (self._known + len(scan.ranges)))
        self._known += remember(
            self._keys, self._records, scan.ranges, scan.angle_min, scan.angle_increment, scan.range_max,
            scan.mount[0], scan.mount[1], scan.mount[2], pose, self.covariance,
        )  # fmt: skip

    def _grow(self, least: int) -> None:
        size = 1 << least.bit_length()
        keys, records = self._keys, self._records
        self._keys = np.full(size, _FREE)
        self._records = np.empty((size, 11))
        rehash(keys, records, self._keys, self._records)


@inlined
def _slot(keys: Array, key: int) -> int:
    """Return where a key is, or the free slot where it belongs."""
    mask: int = keys.shape[0] - 1
    at: int = (key ^ (key >> 29)) * 0x9E3779B1 & mask
    while keys[at] != _FREE and keys[at] != key:
        at = (at + 1) & mask
    return at


@inlined
def _key(x: float, y: float) -> int:
    return (math.floor(x / _CELL) << 32) ^ (math.floor(y / _CELL) & 0xFFFFFFFF)


@kernel
def rehash(keys: Array, records: Array, new_keys: Array, new_records: Array) -> None:
    """Copy all records into a larger table."""
    for i in range(keys.shape[0]):
        if keys[i] != _FREE:
            at = _slot(new_keys, keys[i])
            new_keys[at] = keys[i]
            new_records[at] = records[i]


@kernel
def remember(
    keys: Array, records: Array, ranges: Array, angle_min: float, angle_increment: float, range_max: float,
    mx: float, my: float, myaw: float, pose: Array, covariance: Array,
) -> int:  # fmt: skip
    """Store pose and covariance for cells seen for the first time; return how many."""
    new = 0
    c, s = math.cos(pose[2]), math.sin(pose[2])
    ox, oy = pose[0] + c * mx - s * my, pose[1] + s * mx + c * my
    for i in range(ranges.shape[0]):
        r = float(ranges[i])
        if not (0.0 < r < range_max):
            continue
        angle = pose[2] + myaw + angle_min + i * angle_increment
        key = _key(ox + r * math.cos(angle), oy + r * math.sin(angle))
        at = _slot(keys, key)
        if keys[at] == _FREE:
            keys[at] = key
            records[at, 0] = pose[0]
            records[at, 1] = pose[1]
            for j in range(9):
                records[at, 2 + j] = covariance[j // 3, j % 3]
            new += 1
    return new


@kernel
def posterior_in_map(
    keys: Array, records: Array, ranges: Array, angle_min: float, angle_increment: float, range_max: float,
    mx: float, my: float, myaw: float, pose: Array, last_pose: Array, last: Array, last_local: Array, prior: Array,
    information: Array, H: Array, inflation: float, out: Array,
) -> None:  # fmt: skip
    """Write the covariance of `pose` in the map's frame."""
    # what the map around is worth: the mean over the cells that the scan sees
    around = np.zeros((3, 3))
    count = 0
    c, s = math.cos(pose[2]), math.sin(pose[2])
    ox, oy = pose[0] + c * mx - s * my, pose[1] + s * mx + c * my
    n = ranges.shape[0]
    for i in range(0, n, max(1, n // _BEAMS)):
        r = float(ranges[i])
        if not (0.0 < r < range_max):
            continue
        angle = pose[2] + myaw + angle_min + i * angle_increment
        at = _slot(keys, _key(ox + r * math.cos(angle), oy + r * math.sin(angle)))
        if keys[at] != _FREE:
            _add_moved(records[at, 2:].reshape(3, 3), pose[0] - records[at, 0], pose[1] - records[at, 1], around)
            count += 1
    # the prior in the map: the last posterior, moved, and what the motion since added
    moved = np.zeros((3, 3))
    local = np.zeros((3, 3))
    _add_moved(last, pose[0] - last_pose[0], pose[1] - last_pose[1], moved)
    _add_moved(last_local, pose[0] - last_pose[0], pose[1] - last_pose[1], local)
    for i in range(3):
        if prior[i, i] > local[i, i]:
            moved[i, i] += prior[i, i] - local[i, i]
    if count == 0:
        out[:] = moved
        return
    around /= count
    C = np.empty((3, 3))
    _invert(H, information, 0.0, C)
    K = _product(C, H)
    M = _product(K, _root(around))
    L = _root(moved)
    M += L - _product(K, L)
    for i in range(3):
        for j in range(i + 1):
            v = 0.0
            for k in range(3):
                v += M[i, k] * M[j, k] + 0.5 * inflation * (K[i, k] * C[k, j] + K[j, k] * C[k, i])
            out[i, j] = out[j, i] = v


@inlined
def _product(A: Array, B: Array) -> Array:
    """Return A B, both (3, 3)."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
    return out


@inlined
def _add_moved(P: Array, dx: float, dy: float, out: Array) -> None:
    """Add J P J^T: an error of the pose at one place as seen at a place (dx, dy) away."""
    ax, ay = -dy, dx
    x2, y2 = P[0, 2] + ax * P[2, 2], P[1, 2] + ay * P[2, 2]
    out[0, 0] += P[0, 0] + ax * (P[0, 2] + x2)
    out[1, 1] += P[1, 1] + ay * (P[1, 2] + y2)
    xy = P[0, 1] + ay * P[0, 2] + ax * y2
    out[0, 1] += xy
    out[1, 0] += xy
    out[0, 2] += x2
    out[2, 0] += x2
    out[1, 2] += y2
    out[2, 1] += y2
    out[2, 2] += P[2, 2]


@inlined
def _root(P: Array) -> Array:
    """Return the lower Cholesky factor of a positive semi-definite matrix."""
    L = np.zeros((3, 3))
    for j in range(3):
        d = P[j, j]
        for k in range(j):
            d -= L[j, k] * L[j, k]
        L[j, j] = math.sqrt(max(d, 1e-18))
        for i in range(j + 1, 3):
            v = P[i, j]
            for k in range(j):
                v -= L[i, k] * L[j, k]
            L[i, j] = v / L[j, j]
    return L


@kernel
def scan_alone(pose: Array, H: Array, g: Array, information: Array, covariance: Array, mean: Array) -> None:
    """Write the covariance (H + information)^-1 (3, 3) and the mean (3,) that the scan alone has.

    Directions of which the scan says nothing get its pose's mean and, without a prior, a large variance.
    """
    _invert(H, information, 1e-9, covariance)
    alone = np.empty((3, 3))
    _invert(H, np.zeros((3, 3)), 1e-6, alone)
    for i in range(3):
        mean[i] = pose[i] - alone[i, 0] * g[0] - alone[i, 1] * g[1] - alone[i, 2] * g[2]


@inlined
def _invert(A: Array, B: Array, ridge: float, out: Array) -> None:
    """Write (A + B + ridge diag)^-1, by Cholesky."""
    more = 1.0 + ridge
    tiny = 1e-6
    l00 = math.sqrt((A[0, 0] + B[0, 0]) * more + tiny)
    l10 = (A[1, 0] + B[1, 0]) / l00
    l20 = (A[2, 0] + B[2, 0]) / l00
    l11 = math.sqrt(max((A[1, 1] + B[1, 1]) * more + tiny - l10 * l10, tiny))
    l21 = (A[2, 1] + B[2, 1] - l20 * l10) / l11
    l22 = math.sqrt(max((A[2, 2] + B[2, 2]) * more + tiny - l20 * l20 - l21 * l21, tiny))
    i00 = 1.0 / l00
    i11 = 1.0 / l11
    i22 = 1.0 / l22
    i10 = -l10 * i00 * i11
    i21 = -l21 * i11 * i22
    i20 = (l10 * l21 * i11 - l20) * i00 * i22
    out[0, 0] = i00 * i00 + i10 * i10 + i20 * i20
    out[1, 1] = i11 * i11 + i21 * i21
    out[2, 2] = i22 * i22
    out[0, 1] = out[1, 0] = i10 * i11 + i20 * i21
    out[0, 2] = out[2, 0] = i20 * i22
    out[1, 2] = out[2, 1] = i21 * i22
