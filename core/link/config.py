"""The config keys that both ends of a link share."""

from pydantic import Field, field_validator

from knotwork.core.manifest import PluginConfig


class LinkConfig(PluginConfig):
    """Which link, and where the other machine is."""

    link: str = Field("robot", pattern=r"^[\w-]+$", description="name of the link; the same at both of its ends")
    listen: tuple[str, ...] = Field((), description="endpoints others connect to, e.g. tcp/0.0.0.0:7447")
    connect: tuple[str, ...] = Field((), description="endpoints to connect to, e.g. tcp/192.168.1.7:7447")
    scouting: bool = Field(False, description="also look for other machines by multicast")

    @field_validator("listen", "connect")
    @classmethod
    def _endpoints(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for endpoint in value:
            protocol, _, address = endpoint.partition("/")
            if not protocol.isalnum() or not address:
                raise ValueError(f"expected protocol/address such as tcp/192.168.1.7:7447, got {endpoint!r}")
        return value
