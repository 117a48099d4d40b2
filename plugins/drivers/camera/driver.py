"""Files as a pulled driver: pictures in, tracked points out."""

from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from knotwork.core.contracts import Context, Driver
from knotwork.core.errors import DriverError
from knotwork.core.messages import Features, Message
from knotwork.plugins.drivers.camera import Config
from knotwork.plugins.drivers.camera.calibration import read_calibration
from knotwork.plugins.drivers.camera.tracker import Picture, Tracker

_IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm")


class Camera(Driver):
    """Frame k is stamped k / rate."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.config: Config = context.config
        self.calibration = read_calibration(self.config.calibration)
        self._tracker = Tracker(self.config)
        self._capture: Any = None
        self._files: list[Path] = []
        self._done = 0
        self._total = 0

    def open(self) -> None:
        """Find the images, or open the video.

        Raises
        ------
        DriverError
            There is nothing to see.
        """
        source = self.config.source
        if source.is_dir():
            self._files = sorted(p for p in source.iterdir() if p.suffix.lower() in _IMAGES)
            self._total = len(self._files)
            if not self._files:
                raise DriverError("no images in the folder", where=str(source), hint=f"expected {', '.join(_IMAGES)}")
            return
        if not source.is_file():
            raise DriverError("no such video file or folder of images", where=str(source))
        self._capture = cv2.VideoCapture(str(source))
        if not self._capture.isOpened():
            raise DriverError("cannot open the video", where=str(source))
        self._total = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))

    def events(self) -> Iterator[tuple[str, Message] | int]:
        """Yield the points of each picture."""
        for k, (stamp, picture) in enumerate(self._pictures()):
            self._done = k + 1
            ids, pixels = self._tracker.follow(picture)
            yield "features", Features(stamp=stamp, ids=ids, points=self.calibration.normalised(pixels))

    def progress(self) -> float | None:
        """Return the share of the pictures that has been given."""
        return min(1.0, self._done / self._total) if self._total > 0 else None

    def close(self) -> None:
        """Release the file."""
        if self._capture is not None:
            self._capture.release()

    def _pictures(self) -> Iterator[tuple[int, Picture]]:
        rate = self.config.rate
        if self._capture is None:
            for k, path in enumerate(self._files):
                picture: Any = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
                if picture is None:
                    self.context.count("unreadable_images")
                    self.context.report("warning", f"{path.name} is not an image that can be read; skipped")
                    continue
                yield round(k * 1e9 / rate), picture
            return
        told = float(self._capture.get(cv2.CAP_PROP_FPS))
        rate = told if np.isfinite(told) and told > 0.0 else rate
        for k in count():
            there, frame = self._capture.read()
            if not there:
                return
            grey: Any = frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
            yield round(k * 1e9 / rate), grey
