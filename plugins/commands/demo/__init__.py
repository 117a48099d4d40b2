"""`knotwork demo`: a simulated TurtleBot3 maps an apartment; needs no data and no robot."""

from knotwork.core.manifest import Manifest

MANIFEST = Manifest(
    name="demo",
    kind="command",
    summary="map a simulated apartment with a simulated TurtleBot3",
    impl="knotwork.plugins.commands.demo.command:Demo",
)
