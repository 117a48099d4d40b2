"""A connected camera as a pushing driver; it comes back by itself after it was unplugged."""

from threading import Condition, Thread
from threading import Event as Flag
from typing import Any

import cv2

from knotwork.core import clock
from knotwork.core.contracts import Context, Driver
from knotwork.core.errors import DriverError
from knotwork.core.messages import Features
from knotwork.plugins.drivers.camera import LiveConfig
from knotwork.plugins.drivers.camera.calibration import read_calibration
from knotwork.plugins.drivers.camera.tracker import Picture, Tracker

_AGAIN = 1.0  # s between attempts to open a camera that has gone


class LiveCamera(Driver):
    """Pictures are stamped by when they arrive, less the camera's latency."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.config: LiveConfig = context.config
        self.calibration = read_calibration(self.config.calibration)
        self._tracker = Tracker(self.config)
        self._capture: Any = None
        self._stop = Flag()
        self._newest: tuple[int, Picture] | None = None
        self._fresh = Condition()
        # Pictures wait in the camera's queue and grow old there while one is tracked, unless somebody takes them out.
        self._threads = [
            Thread(target=work, name=f"{context.name} {name}", daemon=True)
            for name, work in (("camera", self._take), ("tracker", self._track))
        ]

    def open(self) -> None:
        """Open the device.

        Raises
        ------
        DriverError
            It cannot be opened.
        """
        if not self._connect():
            hint = "is it plugged in, or its address right?"
            raise DriverError("cannot open the camera", where=f"device {self.config.device}", hint=hint)

    def start(self) -> None:
        """Start taking pictures."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Stop taking pictures."""
        self._stop.set()
        with self._fresh:
            self._fresh.notify()
        for thread in self._threads:
            thread.join(timeout=2.0)

    def close(self) -> None:
        """Release the device."""
        if self._capture is not None:
            self._capture.release()

    def _connect(self) -> bool:
        self._capture = cv2.VideoCapture(self.config.device)
        if self.config.size is not None:
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, self.config.size[0])
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self.config.size[1])
        if self.config.rate is not None:
            self._capture.set(cv2.CAP_PROP_FPS, self.config.rate)
        return bool(self._capture.isOpened())

    def _take(self) -> None:
        while not self._stop.is_set():
            there, frame = self._capture.read()
            stamp = clock.epoch() - round(self.config.latency * 1e9)
            if not there:
                self.context.count("lost_camera")
                self.context.report("warning", "the camera gives no pictures; trying to open it again")
                self._capture.release()
                while not self._stop.wait(_AGAIN) and not self._connect():
                    pass
                continue
            grey: Any = frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
            with self._fresh:
                if self._newest is not None:
                    self.context.count("skipped_pictures")
                self._newest = stamp, grey
                self._fresh.notify()

    def _track(self) -> None:
        while not self._stop.is_set():
            with self._fresh:
                self._fresh.wait_for(lambda: self._newest is not None or self._stop.is_set())
                newest, self._newest = self._newest, None
            if newest is None:
                return
            stamp, picture = newest
            ids, pixels = self._tracker.follow(picture)
            points = self.calibration.normalised(pixels)
            self.context.emit("features", Features(stamp=stamp, ids=ids, points=points))
