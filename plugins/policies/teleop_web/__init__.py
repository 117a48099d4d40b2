"""Plugin `teleop-web`: a person drives by the stick on the live page."""

from knotwork.core.manifest import Manifest, PluginConfig, Port, Use, quantity


class TeleopWebConfig(PluginConfig):
    """How fast the stick at its end is."""

    speed: float = quantity(0.2, "m/s", "forward speed at the stick's end", gt=0)
    yaw_rate: float = quantity(1.0, "rad/s", "turning at the stick's end", gt=0)
    rate: float = quantity(20.0, "Hz", "commands a second", ge=10, le=100)


MANIFEST = Manifest(
    name="teleop-web",
    kind="policy",
    summary="drives by the stick on the page of the sink `live`",
    impl="knotwork.plugins.policies.teleop_web.policy:TeleopWeb",
    config=TeleopWebConfig,
    outputs={"twist": Port("twist", summary="the command")},
    uses={"stick": Use("stick", summary="the sink `live`")},
    push=True,
    example="drive: {plugin: teleop-web, speed: 0.15}",
)
