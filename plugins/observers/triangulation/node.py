"""Keeps views of each feature and triangulates it in every frame."""

import numpy as np

from knotwork.core.contracts import Context, Observer
from knotwork.core.depth.tracks import usable
from knotwork.core.depth.triangulation import from_projections, from_rays
from knotwork.core.messages import F64, CameraPose, Depths, Features
from knotwork.plugins.observers.triangulation import Config

View = tuple[F64, F64, F64]  # position, rotation, image point


class Triangulation(Observer):
    """First view, recent views and the present one of each feature."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.config: Config = context.config
        self._solve = from_rays if self.config.method == "rays" else from_projections
        self._views: dict[int, list[View]] = {}
        self._camera: CameraPose | None = None

    def on_camera(self, message: CameraPose) -> None:
        """Take the pose of the camera."""
        self._camera = message

    def on_features(self, message: Features) -> None:
        """Give the depth of each feature in view."""
        camera = self._camera
        if camera is None:
            self.context.count("features_without_pose")
            return
        good = usable(message.ids, message.points)
        if not good.all():
            self.context.count("skipped_features", int((~good).sum()))
        ids, points = message.ids[good], message.points[good]
        chi, condition = np.full(ids.size, np.nan), np.full(ids.size, np.inf)
        for i, (name, point) in enumerate(zip(ids.tolist(), points, strict=True)):
            chi[i], condition[i] = self._depth(name, (camera.position, camera.rotation, point))
        self.context.emit("depths", Depths(stamp=message.stamp, ids=ids, points=points, chi=chi, condition=condition))

    def _depth(self, name: int, view: View) -> tuple[float, float]:
        views = self._views.setdefault(name, [])
        chi, condition = np.nan, np.inf
        if views:
            positions, rotations, points = (np.array(part) for part in zip(*views, view, strict=True))
            q, condition = self._solve(positions, rotations, points)
            depth = float(view[1][:, 2] @ (q - view[0]))
            if condition <= self.config.condition and depth > 0.0:
                chi = 1.0 / depth
            else:
                self.context.count("ill_conditioned")
        if not views or np.linalg.norm(view[0] - views[-1][0]) >= self.config.baseline:
            views.append(view)
            if len(views) >= self.config.views:
                del views[1]
        return chi, condition
