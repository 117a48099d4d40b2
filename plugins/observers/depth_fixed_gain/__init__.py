"""Inverse depths of tracked points by the fixed-gain observer of thesis chapter 8."""

from typing import Literal

from knotwork.core.depth.config import INPUTS, OUTPUTS, DepthObserverConfig
from knotwork.core.manifest import Manifest, quantity


class Config(DepthObserverConfig):
    """Gains of (8.12) and the window of the uncertainty (9.41)."""

    k_s: float = quantity(10.0, "1/s", "gain of the image position", gt=0)
    k_chi: float | Literal["critical"] = quantity(
        2500.0, "1/m^2", "gain of the inverse depth; critical: damps the depth error critically at any sigma^2 (8.34)"
    )
    floor: float = quantity(1e-4, "m^2/s^2", "with `critical`: sigma^2 is taken to be at least this", gt=0)
    window: int = quantity(10, "frames", "length T of the window of the uncertainty", ge=1, le=10000)


MANIFEST = Manifest(
    name="depth-fixed-gain",
    kind="observer",
    summary="inverse depth of each feature by a fixed-gain observer, with its conditions of convergence",
    impl="knotwork.plugins.observers.depth_fixed_gain.node:FixedGain",
    config=Config,
    inputs=INPUTS,
    outputs=OUTPUTS,
    example="depths: {plugin: depth-fixed-gain, inputs: {twist: camera.applied}}",
)
