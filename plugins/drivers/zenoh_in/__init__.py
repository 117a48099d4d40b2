"""Plugin `zenoh-in`: streams from another machine."""

from pydantic import Field, field_validator

from knotwork.core.link.config import LinkConfig
from knotwork.core.manifest import Manifest, PluginConfig, quantity


class RemoteStream(PluginConfig):
    """One stream of the other machine."""

    stream: str = Field(description="as it is called there: `node.port`", pattern=r"^[\w-]+\.[\w-]+$")
    message: str = Field(description="its message type")
    role: str = Field("", pattern="^(prior|estimate|truth|)$", description="of poses and depths")
    extrapolate: bool = Field(
        False, description="odometry that was late is moved on along its twist: to steer by, not to map with"
    )


class ZenohInConfig(LinkConfig):
    """What comes in."""

    streams: dict[str, RemoteStream] = Field(description="output ports, by names of your own", min_length=1)
    late: float = quantity(0.1, "s", "longer on its way counts as late", gt=0)
    horizon: float = quantity(0.5, "s", "odometry that was longer on its way is not extrapolated", gt=0)
    rearm_age: float = quantity(1.0, "s", "a re-arm that was longer on its way is refused", gt=0)

    @field_validator("streams")
    @classmethod
    def _names(cls, value: dict[str, RemoteStream]) -> dict[str, RemoteStream]:
        for name, remote in value.items():
            if name == "link" or not name.replace("-", "").replace("_", "").isalnum():
                raise ValueError(f"{name!r} cannot be the name of a port (letters, digits, - and _; `link` is taken)")
            if remote.extrapolate and remote.message != "odometry":
                raise ValueError(f"{name}: only odometry can be extrapolated")
        if len({remote.stream for remote in value.values() if not remote.extrapolate}) < sum(
            not remote.extrapolate for remote in value.values()
        ):
            raise ValueError("a stream is named twice")
        return value


MANIFEST = Manifest(
    name="zenoh-in",
    kind="driver",
    summary="takes streams from another machine's zenoh-out; estimates its clock, and how old commands are",
    impl="knotwork.plugins.drivers.zenoh_in.driver:ZenohIn",
    config=ZenohInConfig,
    ports="knotwork.plugins.drivers.zenoh_in.ports:outputs",
    push=True,
    extra="zenoh",
    requires=("zenoh",),
    message_types={"link_state": "knotwork.plugins.drivers.zenoh_in.messages:LinkState"},
    example="in: {plugin: zenoh-in, link: robot, connect: [tcp/192.168.1.7:7447], "
    "streams: {scan: {stream: lidar.scan, message: scan}}}",
)
