"""Servoing of one point at the largest possible excitation (thesis section 9.1)."""

from typing import Literal

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class Config(PluginConfig):
    """Goal (a point of the image, or a circle in it), variant, bounds."""

    feature: int = quantity(0, "1", "id of the feature")
    goal: tuple[float, float] = quantity(
        (0.0, 0.0), "1", "where it shall be seen, in normalised image coordinates; the centre of the circle"
    )
    radius: float = quantity(0.0, "1", "of the circle on which the goal goes round; 0: it stands", ge=0)
    period: float = quantity(10.0, "s", "of the circle", gt=0)
    feed_forward: bool = Field(True, description="the goal's own velocity is part of the wanted image velocity")
    variant: Literal["spica14", "varying-depth", "constant-depth"] = Field(
        "varying-depth",
        description="spica14: fixed sideways direction; varying-depth: the observer also converges (J_l w <= 0); "
        "constant-depth: and the depth stays (J_l w = 0)",
    )
    gain: float = quantity(1.0, "1/s", "k_p of the image error", gt=0)
    v_max: float = quantity(0.1, "m/s", "speed: sigma^2 = v_max^2", gt=0)
    w_max: float = quantity(0.15, "rad/s", "largest rate of rotation", gt=0)
    timeout: float = quantity(0.5, "s", "without the feature for so long, the camera stops", gt=0)


MANIFEST = Manifest(
    name="single-point",
    kind="policy",
    summary="servoes one point while its depth is observed as fast as the speed allows",
    impl="knotwork.plugins.policies.single_point.policy:SinglePoint",
    config=Config,
    inputs={"depths": Port("depths", role="estimate", summary="a command goes out for each")},
    outputs={
        "twist": Port("camera_twist", summary="the command"),
        "state": Port("servo_state", summary="error"),
    },
    example="servo: {plugin: single-point, goal: [0.2, 0.1], variant: constant-depth}",
)
