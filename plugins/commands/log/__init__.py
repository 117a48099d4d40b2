"""`knotwork log`: look into a recorded log, check it, make a broken one whole, cut and merge."""

from knotwork.core.manifest import Manifest

MANIFEST = Manifest(
    name="log",
    kind="command",
    summary="look into a recorded log (info), check, recover, cut and merge",
    impl="knotwork.plugins.commands.log.command:LogCommand",
    requires=("mcap", "zstandard", "lz4"),
    example="knotwork log recover run/log.mcap",
)
