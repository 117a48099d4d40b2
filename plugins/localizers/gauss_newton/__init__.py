"""Scan-to-map localiser: damped Gauss-Newton from coarse to fine, with the prior in the cost."""

from typing import Literal

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, Use, quantity


class GaussNewtonConfig(PluginConfig):
    """Config of the localiser."""

    loss: Literal["none", "huber", "cauchy", "geman-mcclure", "welsch"] = Field(
        "cauchy", description="robust loss of a beam's residual"
    )
    scale: float = quantity(6.5, "sigma", "residual at which the loss turns away from a square", gt=0)
    iterations: int = quantity(12, "1", "most steps at each level", ge=1)
    tolerance: float = quantity(1e-3, "1", "a step that lowers the cost by a smaller share is the last", gt=0)
    settle: tuple[float, float] = quantity((2e-4, 5e-5), "m, rad", "a step smaller than both is the last at its level")
    damping: float = quantity(0.5, "1", "first damping of a level: share added to the diagonal of H", gt=0)
    deskew: bool = Field(True, description="move beams to the scan's stamp by the prior's motion")
    patience: float = quantity(
        0.4, "s", "a scan of a time that odometry has not come to waits for it so long; 0: not at all", ge=0
    )

    inflation: float = quantity(
        20.0, "1", "variance of a scan's pose relative to what independent beams would give", ge=1
    )
    fuse_motion: tuple[float, float] = quantity(
        (0.15, 0.15), "m, rad", "a scan is fused once the robot has moved by either since the last fused one"
    )
    known: float = quantity(
        0.1, "1", "a scan of whose beams a smaller share meets the map says nothing: the prior is taken", ge=0, le=1
    )
    doubt: float = quantity(0.6, "1", "a scan of lower quality is not fused", ge=0, le=1)
    lost_after: int = quantity(4, "scans", "so many doubtful scans in a row, and the pose is lost", ge=1)
    found: float = quantity(0.75, "1", "a search that ends with this quality has found the robot", ge=0, le=1)
    search: tuple[float, float] = quantity(
        (0.5, 5.0), "m", "radius of the first search for a lost robot, and of the widest"
    )
    starts: int = quantity(4000, "1", "poses tried in a search", ge=1)
    weak: tuple[float, float] = quantity((0.3, 0.8), "m, rad", "how far from a weak prior starts are tried")
    weak_starts: int = quantity(100, "1", "poses tried around a weak prior", ge=1)
    astray: tuple[float, float] = quantity(
        (1.5, 1.0), "m, rad", "how far from the prior a doubtful scan is looked for, before it counts as doubtful"
    )
    astray_starts: int = quantity(3000, "1", "poses tried for a doubtful scan", ge=1)


MANIFEST = Manifest(
    name="gauss-newton",
    kind="localizer",
    summary="Aligns scans with any map: damped Gauss-Newton, robust loss, coarse to fine, odometry in the cost",
    impl="knotwork.plugins.localizers.gauss_newton.localizer:GaussNewton",
    config=GaussNewtonConfig,
    inputs={"scan": Port("scan")},
    outputs={"pose": Port("pose", role="estimate", summary="pose of each scan, prior included")},
    uses={"map": Use("map"), "prior": Use("prior", optional=True, summary="without it: the last pose")},
    example="localizer: {plugin: gauss-newton, uses: {map: map, prior: prior}}",
)
