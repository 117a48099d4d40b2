"""Messages as the page takes them: JSON, arrays of points as base64."""

import base64
import math
from collections.abc import Callable
from io import BytesIO
from typing import Any

import numpy as np
from PIL import Image as Picture

from knotwork.core import messages as m
from knotwork.core.geometry import Pose2

_MOST_BEAMS = 720
_CENTIMETRES = 100.0
_PICTURE = 480  # px, longer side


def scan(message: m.Scan, at: Pose2 | None) -> dict[str, Any]:
    """Return the hits of a scan in the robot's frame, int16 centimetres in pairs, and where the robot was."""
    ranges = message.ranges.astype(np.float64)
    mx, my, yaw = message.mount
    angles = yaw + message.angle_min + message.angle_increment * np.arange(len(ranges))
    hit = np.isfinite(ranges) & (ranges >= message.range_min) & (ranges < message.range_max) & np.isfinite(angles)
    points = np.column_stack([mx + ranges[hit] * np.cos(angles[hit]), my + ranges[hit] * np.sin(angles[hit])])
    return {"points": _packed(points), "at": _rounded(at)}


def pose(message: m.Pose, at: tuple[float, ...]) -> dict[str, Any]:
    """Return a pose with its covariance as (xx, xy, yy, yaw yaw)."""
    out: dict[str, Any] = {"role": message.role, "at": _rounded(at), "lost": message.lost}
    covariance = message.covariance
    if covariance is not None and np.isfinite(covariance).all():
        out["cov"] = [float(covariance[i, j]) for i, j in ((0, 0), (0, 1), (1, 1), (2, 2))]
    if math.isfinite(message.quality):
        out["quality"] = round(message.quality, 3)
    return out


def image(message: m.Image) -> dict[str, Any] | None:
    """Return an image as a data address; None for pixels in an encoding that is not known."""
    data, kind = message.data, message.encoding
    if kind not in ("jpeg", "png"):
        mode = {"mono8": "L", "rgb8": "RGB", "bgr8": "RGB"}.get(kind)
        size = (message.width, message.height)
        if mode is None or len(data) != message.width * message.height * len(mode) or not data:
            return None
        picture = Picture.frombytes(mode, size, data, "raw", "BGR" if kind == "bgr8" else mode)
        picture.thumbnail((_PICTURE, _PICTURE))
        out = BytesIO()
        picture.save(out, "JPEG", quality=70)
        data, kind = out.getvalue(), "jpeg"
    return {"src": f"data:image/{kind};base64,{base64.b64encode(data).decode()}"}


def features(message: m.Features) -> dict[str, Any]:
    """Return tracked points in normalised image coordinates."""
    return {"ids": message.ids.tolist(), "points": _plain(message.points)}


def depths(message: m.Depths) -> dict[str, Any]:
    """Return inverse depths with their sigma, where one is stated."""
    sigma = None if message.variance is None else _plain(np.sqrt(np.maximum(message.variance, 0.0)))
    return {
        "role": message.role,
        "ids": message.ids.tolist(),
        "points": _plain(message.points),
        "chi": _plain(message.chi),
        "sigma": sigma,
    }


def servo(message: m.ServoState) -> dict[str, Any]:
    """Return what a vision policy is doing."""
    return {"phase": message.phase, "error": _plain(message.error), "exciting": message.exciting}


def twist(message: m.Twist) -> dict[str, Any]:
    """Return a command."""
    return {"vx": _plain(message.vx), "vy": _plain(message.vy), "wz": _plain(message.wz)}


def state(message: m.MotionState) -> dict[str, Any]:
    """Return whether the base may move."""
    return {"state": message.state, "reason": message.reason}


def battery(message: m.Battery) -> dict[str, Any]:
    """Return voltage and charge."""
    return {"voltage": _plain(message.voltage), "charge": _plain(message.charge)}


def statistics(message: m.Statistics) -> dict[str, Any]:
    """Return the figures of the nodes."""
    wanted = ("n", "mean_ms", "p95_ms", "max_ms", "drops")
    nodes = message.data.get("nodes", {})
    return {
        "nodes": {name: {k: _plain(row[k]) for k in wanted if k in row} for name, row in nodes.items()},
        "memory": _plain(message.data.get("peak_rss_mb")),
    }


# Message type to the part of the page it belongs to and how it gets there.
SECTIONS: dict[type, tuple[str, Callable[[Any], Any]]] = {
    m.Image: ("images", image),
    m.Features: ("features", features),
    m.Depths: ("depths", depths),
    m.ServoState: ("servo", servo),
    m.Twist: ("twists", twist),
    m.MotionState: ("motion", state),
    m.Battery: ("battery", battery),
    m.Statistics: ("statistics", statistics),
}


def _packed(points: m.F64) -> str:
    finite = points[np.isfinite(points).all(axis=1)]
    thin = finite[:: max(1, -(-len(finite) // _MOST_BEAMS))]
    whole = np.clip(np.rint(thin * _CENTIMETRES), -32768, 32767).astype("<i2")
    return base64.b64encode(whole.tobytes()).decode()


def _rounded(at: tuple[float, ...] | None) -> list[float] | None:
    if at is None or not all(map(math.isfinite, at)):
        return None
    return [round(at[0], 4), round(at[1], 4), round(at[2], 5)]


def _plain(value: Any) -> Any:
    """Return numbers that JSON can hold; what is not finite becomes null."""
    if isinstance(value, np.ndarray):
        return [_plain(each) for each in value.tolist()]
    if isinstance(value, list):
        return [_plain(each) for each in value]
    if isinstance(value, float):
        return float(f"{value:.5g}") if math.isfinite(value) else None
    return value
