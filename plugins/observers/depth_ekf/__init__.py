"""Inverse depths of tracked points by an extended Kalman filter for each."""

from knotwork.core.depth.config import INPUTS, OUTPUTS, DepthObserverConfig
from knotwork.core.manifest import Manifest, quantity


class Config(DepthObserverConfig):
    """Noise of the image and of the motion."""

    noise: float = quantity(1e-3, "1", "standard deviation of a normalised image coordinate", gt=0)
    guess_sd: float = quantity(3.0, "1/m", "standard deviation of the guessed inverse depth", gt=0)
    position_growth: float = quantity(
        1e-4, "1/sqrt(s)", "growth of the image position's standard deviation: error of the known motion", ge=0
    )
    depth_growth: float = quantity(
        0.0, "1/sqrt(s)", "growth of the relative standard deviation of chi: error of the known motion", ge=0
    )


MANIFEST = Manifest(
    name="depth-ekf",
    kind="observer",
    summary="inverse depth of each feature by an extended Kalman filter, with its variance",
    impl="knotwork.plugins.observers.depth_ekf.node:DepthEkf",
    config=Config,
    inputs=INPUTS,
    outputs=OUTPUTS,
    example="depths: {plugin: depth-ekf, inputs: {twist: camera.applied}}",
)
