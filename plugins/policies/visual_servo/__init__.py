"""Visual servoing of many points with estimated depths, passive or active (thesis section 9.2)."""

from typing import Literal

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class Config(PluginConfig):
    """Goal, gain, bounds, and when a depth is believed."""

    goal: dict[int, tuple[float, float]] = quantity(
        ..., "1", "where each feature shall be seen, by its id, in normalised image coordinates", min_length=1
    )
    mode: Literal["passive", "active", "active+", "ideal"] = Field(
        "active+",
        description="passive: servo only; active: move so that depths converge, (9.46); active+: and never too "
        "slowly; ideal: servo with true depths",
    )
    gain: float = quantity(1.0, "1/s", "lambda: rate at which the image error shall fall", gt=0)
    v_max: float = quantity(0.1, "m/s", "largest speed", gt=0)
    w_max: float = quantity(0.15, "rad/s", "largest rate of rotation", gt=0)
    excitation: float = quantity(
        0.9, "1", "active+: share of v_max that goes sideways while a depth is uncertain", gt=0, le=0.95
    )
    uncertainty: tuple[float, float] = quantity(
        (1e-7, 1e-6), "1", "E of (9.41) at which a depth is certain, and at which it is not at all"
    )
    deviation: tuple[float, float] = quantity(
        (0.05, 0.2), "1", "the same for an observer with variances: relative standard deviations"
    )
    solver: str = Field(
        "clarabel",
        description="clarabel (second-order cones), compiled (built in, as exact), or with tangent planes a solver of "
        "qpsolvers: osqp, daqp, piqp, quadprog, scs, qpalm",
    )
    timeout: float = quantity(0.5, "s", "without depths for so long, the camera stops", gt=0)


MANIFEST = Manifest(
    name="visual-servo",
    kind="policy",
    summary="moves a camera to a goal view, and so that the depths it needs for that converge",
    impl="knotwork.plugins.policies.visual_servo.policy:VisualServo",
    config=Config,
    inputs={
        "depths": Port("depths", role="estimate", optional=True, summary="a command goes out for each"),
        "truth": Port("depths", role="truth", optional=True, summary="taken instead in mode ideal"),
    },
    outputs={
        "twist": Port("camera_twist", summary="the command"),
        "state": Port("servo_state", summary="phase, error and certainty"),
    },
    example='servo: {plugin: visual-servo, goal: {"0": [0.1, 0.0], "1": [0.0, 0.1]}, mode: active+}',
)
