"""Plugin `zenoh-out`: streams to another machine."""

from typing import Literal

from pydantic import Field

from knotwork.core.link.config import LinkConfig
from knotwork.core.manifest import Manifest, Port, quantity


class ZenohOutConfig(LinkConfig):
    """What is sent, and what is kept while the other machine cannot be reached."""

    include: tuple[str, ...] = Field(("*",), description="streams to send, as `node.port` with * and ?")
    exclude: tuple[str, ...] = Field(("runtime.*",), description="streams to leave out of these")
    buffer: float = quantity(32.0, "MB", "kept until the other end has it; the oldest are lost beyond", gt=0)
    window: float = quantity(1.0, "MB", "on their way at a time", gt=0)
    when_full: Literal["auto", "block", "drop-oldest"] = Field(
        "auto", description="auto: a log or a simulation waits for the other end, a robot drops the oldest"
    )
    retry: float = quantity(0.3, "s", "without an acknowledgement for so long, it is sent again", gt=0)
    drain: float = quantity(5.0, "s", "at the end of a run, wait so long for the last acknowledgements", ge=0)


MANIFEST = Manifest(
    name="zenoh-out",
    kind="sink",
    summary="sends streams to another machine's zenoh-in: in order, again after a lost link, commands only fresh",
    impl="knotwork.plugins.sinks.zenoh_out.sink:ZenohOut",
    config=ZenohOutConfig,
    inputs={"all": Port("*", many=True, summary="every stream of the pipeline")},
    extra="zenoh",
    requires=("zenoh",),
    example="out: {plugin: zenoh-out, link: robot, listen: [tcp/0.0.0.0:7447], include: [lidar.scan, base.odometry]}",
)
