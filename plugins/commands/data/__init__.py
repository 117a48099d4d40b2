"""`knotwork data`: find, fetch, look at and convert recorded data sets."""

from knotwork.core.manifest import Manifest

MANIFEST = Manifest(
    name="data",
    kind="command",
    summary="recorded data sets: list, fetch, info of any recording, convert to MCAP",
    impl="knotwork.plugins.commands.data.command:DataCommand",
    example="knotwork data fetch intel",
)
