"""The simulated camera as a pulled driver in closed loop."""

from collections.abc import Iterator
from itertools import count

import numpy as np

from knotwork.core.camera import move_points, rigid_step
from knotwork.core.contracts import Context, Driver
from knotwork.core.messages import F64, CameraPose, CameraTwist, Depths, Features, Message, Twist
from knotwork.core.world.seeding import generator
from knotwork.plugins.drivers.sim_camera import Config


class SimCamera(Driver):
    """At frame k it gives the command that held over (k-1, k], then pose, truth and features at k."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.config: Config = context.config
        self.points = np.array(self.config.points)
        self.position = np.zeros(3)
        self.rotation = np.eye(3)
        self._scale = np.array(self.config.twist_scale)
        self._spread = np.repeat(self.config.twist_noise, 3)
        self._pixels = generator(context.seed, "pixels")
        self._losses = generator(context.seed, "losses")
        self._motion = generator(context.seed, "motion")
        self._command = np.zeros(6)
        self._command_stamp: int | None = None
        self._step_rotation = np.eye(3)
        self._step_shift = np.zeros(3)
        self._now = 0

    def warm(self) -> None:
        """Compile the kernels."""
        rigid_step(np.zeros(3), np.zeros(3), 0.0, self._step_rotation, self._step_shift)
        move_points(np.ones((1, 3)), self._step_rotation, self._step_shift)

    def on_command(self, message: CameraTwist) -> None:
        """Take a velocity of the camera."""
        if self.config.base_offset is not None:
            self.context.count("ignored_commands")
            return
        self._take(np.concatenate((message.v, message.w)), message.stamp)

    def on_twist(self, message: Twist) -> None:
        """Take a velocity of the base: the camera looks forward, its x is the base's -y, its y points down."""
        offset = self.config.base_offset
        if offset is None:
            self.context.count("ignored_commands")
            return
        self._take(np.array((-offset * message.wz, 0.0, message.vx, 0.0, -message.wz, 0.0)), message.stamp)

    def events(self) -> Iterator[tuple[str, Message] | int]:
        """Yield the time of each frame, then what is there."""
        for k in count():
            stamp = round(k * 1e9 / self.config.rate)
            if stamp > round(self.config.duration * 1e9):
                return
            yield stamp
            applied = self._move(self._now, stamp)
            self._now = stamp
            yield "applied", CameraTwist(stamp=stamp, v=applied[:3], w=applied[3:])
            yield (
                "camera",
                CameraPose(stamp=stamp, role="truth", position=self.position.copy(), rotation=self.rotation.copy()),
            )
            yield from self._frame(stamp)

    def stop_motion(self) -> None:
        """Forget the command."""
        self._command[:] = 0.0

    def progress(self) -> float | None:
        """Return the share of the duration that has passed."""
        return min(1.0, self._now * 1e-9 / self.config.duration)

    def _take(self, command: F64, stamp: int) -> None:
        if not np.isfinite(command).all():
            self.context.count("bad_commands")
            self.context.report("warning", "command ignored: it is not finite")
            return
        self._command, self._command_stamp = command, stamp

    def _move(self, start: int, end: int) -> F64:
        oldest = start - round(self.config.command_timeout * 1e9)
        if self._command_stamp is not None and self._command_stamp < oldest:
            self.context.count("command_timeouts")
            self._command = np.zeros(6)
            self._command_stamp = None
        applied = self._command.copy()
        if end > start:
            true = applied * self._scale
            if self._spread.any():
                true += self._spread * self._motion.normal(size=6)
            rigid_step(true[:3], true[3:], (end - start) * 1e-9, self._step_rotation, self._step_shift)
            move_points(self.points, self._step_rotation, self._step_shift)
            self.position += self.rotation @ self._step_shift
            self.rotation = self.rotation @ self._step_rotation
        return applied

    def _frame(self, stamp: int) -> Iterator[tuple[str, Message]]:
        depth = self.points[:, 2]
        front = depth >= self.config.nearest
        if not front.all():
            self.context.count("points_behind", int((~front).sum()))
        image = self.points[:, :2] / np.where(front, depth, np.inf)[:, None]
        seen = front & self._visible(image, stamp)
        ids = np.flatnonzero(seen)
        yield (
            "truth",
            Depths(stamp=stamp, role="truth", ids=ids, points=image[ids], chi=1.0 / depth[ids]),
        )
        # Numbers are drawn for all points, so that what one loses does not shift another's noise.
        noise = self._pixels.normal(size=image.shape) if self.config.noise else np.zeros(image.shape)
        yield "features", Features(stamp=stamp, ids=ids, points=(image + self.config.noise * noise)[ids])

    def _visible(self, image: F64, stamp: int) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        config = self.config
        seen = np.ones(len(image), dtype=np.bool_)
        if config.view is not None:
            seen &= (np.abs(image) <= config.view).all(axis=1)
        if config.loss:
            seen &= self._losses.random(len(image)) >= config.loss
        for hidden in config.hidden:
            if hidden.start * 1e9 <= stamp < hidden.end * 1e9:
                seen[[i for i in hidden.ids if 0 <= i < len(image)]] = False
        return seen
