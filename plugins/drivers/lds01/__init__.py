"""Plugins `lds01` and `lds02`: the lidars of a TurtleBot3, on their serial adapter."""

from typing import Literal

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class Config(PluginConfig):
    """Where the lidar is, which one it is and how it is mounted."""

    port: str = Field(
        "/dev/serial/by-id/usb-Silicon_Labs_CP2102_USB_to_UART_Bridge_Controller_0001-if00-port0",
        description="serial device; a link below /dev/serial/by-id stays the same after replugging",
        min_length=1,
    )
    model: Literal["lds01", "lds02", "lds03", "auto"] = Field("lds01", description="auto: find out by listening")
    mount: tuple[float, float, float] = quantity(
        (-0.032, 0.0, 0.0), "m, m, rad", "pose of the lidar in the base frame; a Waffle's is [-0.064, 0, 0]"
    )
    zero: float = quantity(
        0.0, "rad", "added to every angle; an LDS-01's zero is uncertain by a degree (0.01745)", ge=-3.2, le=3.2
    )
    beams: int = quantity(
        720,
        "1",
        "beams of the scan of an LDS-02 or LDS-03, whose points come at varying angles (an LDS-01 has 360)",
        ge=90,
        le=3600,
    )
    frame: str = Field("laser", description="name of the sensor frame")


class Lds02Config(Config):
    """As of `lds01`."""

    model: Literal["lds01", "lds02", "lds03", "auto"] = Field("lds02", description="auto: find out by listening")


_OUTPUTS = {"scan": Port("scan", summary="each turn, at its end; the stamp is its first beam's time")}
_IMPL = "knotwork.plugins.drivers.lds01.driver:Lds"

MANIFEST = [
    Manifest(
        name="lds01",
        kind="driver",
        summary="LDS-01, the lidar of a TurtleBot3 (or an LDS-02, LDS-03: model)",
        impl=_IMPL,
        config=Config,
        outputs=_OUTPUTS,
        provides=("packets",),
        push=True,
        example="lidar: {plugin: lds01, port: /dev/ttyUSB0}",
    ),
    Manifest(
        name="lds02",
        kind="driver",
        summary="LDS-02, the lidar of newer TurtleBot3s (or an LDS-01, LDS-03: model)",
        impl=_IMPL,
        config=Lds02Config,
        outputs=_OUTPUTS,
        provides=("packets",),
        push=True,
        example="lidar: {plugin: lds02, port: /dev/ttyUSB0}",
    ),
]
