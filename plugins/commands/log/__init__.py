"""`knotwork log`: look into a recorded log, make a broken one whole."""

from knotwork.core.manifest import Manifest

MANIFEST = Manifest(
    name="log",
    kind="command",
    summary="look into a recorded log (info), make one whole that was cut short (recover)",
    impl="knotwork.plugins.commands.log.command:LogCommand",
    requires=("mcap", "zstandard", "lz4"),
    example="knotwork log recover run/log.mcap",
)
