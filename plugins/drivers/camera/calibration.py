"""The calibration file: pinhole numbers and distortion, checked."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from knotwork.core.camera import Pinhole
from knotwork.core.errors import InputError
from knotwork.core.messages import F64

_HINT = "a calibration file has the lines fx: 500, fy: 500, cx: 320, cy: 240 and may have distortion: [k1, k2, p1, p2]"
_LENGTHS = (4, 5, 8, 12, 14)  # what OpenCV takes


@dataclass(frozen=True, slots=True)
class Calibration:
    """A camera and the coefficients of its lens (k1, k2, p1, p2, ...), empty for none."""

    pinhole: Pinhole
    distortion: tuple[float, ...]

    def normalised(self, pixels: F64) -> F64:
        """Return normalised coordinates (n, 2) of pixels (n, 2), the lens taken out."""
        pinhole = self.pinhole
        if not len(pixels) or not self.distortion:
            return pinhole.normalised(pixels)
        matrix = np.array(((pinhole.fx, 0.0, pinhole.cx), (0.0, pinhole.fy, pinhole.cy), (0.0, 0.0, 1.0)))
        straight: Any = cv2.undistortPoints(pixels[:, None], matrix, np.array(self.distortion))
        out: F64 = straight[:, 0].astype(np.float64)
        return out


def read_calibration(path: Path) -> Calibration:
    """Read a calibration file.

    Raises
    ------
    InputError
        It cannot be read, a number is missing or impossible, or a key is unknown.
    """
    try:
        data: Any = yaml.safe_load(path.read_text())
    except OSError as error:
        raise InputError(f"cannot read the calibration: {error.strerror}", where=str(path)) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError("not a YAML file", where=str(path), hint=_HINT) from error
    if not isinstance(data, dict):
        raise InputError("not a calibration", where=str(path), hint=_HINT)
    unknown = sorted(str(key) for key in data.keys() - {"fx", "fy", "cx", "cy", "distortion"})
    if unknown:
        raise InputError(f"unknown: {', '.join(unknown)}", where=str(path), hint=_HINT)
    numbers = [_number(data, name, path) for name in ("fx", "fy", "cx", "cy")]
    lens = data.get("distortion", [])
    if not isinstance(lens, list) or (lens and len(lens) not in _LENGTHS):
        raise InputError(f"distortion: expected {_LENGTHS} numbers in a list", where=str(path), hint=_HINT)
    coefficients = tuple(_number(dict(enumerate(lens)), i, path) for i in range(len(lens)))
    try:
        return Calibration(Pinhole(*numbers), coefficients)
    except InputError as error:
        raise InputError(error.message, where=str(path)) from error


def _number(data: dict[Any, Any], name: Any, path: Path) -> float:
    value = data.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        found = "nothing" if value is None else repr(value)
        raise InputError(f"{name}: expected a number, found {found}", where=str(path), hint=_HINT)
    return float(value)
