"""`knotwork emulate`: a robot's electronics in front of a simulated world, for the drivers to talk to."""

from knotwork.core.manifest import Manifest

MANIFEST = Manifest(
    name="emulate",
    kind="command",
    summary="emulate a robot's electronics, byte for byte, in a simulated world",
    impl="knotwork.plugins.commands.emulate.command:Emulate",
    example="knotwork emulate turtlebot3 --world apartment --truth truth.tum",
)
