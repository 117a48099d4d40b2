"""`knotwork replay`: run a logged pipeline again from its own log, or prove that it gives the same."""

from knotwork.core.manifest import Manifest

MANIFEST = Manifest(
    name="replay",
    kind="command",
    summary="run a logged pipeline again from the log's own sources; --check names the first difference",
    impl="knotwork.plugins.commands.replay.command:Replay",
    requires=("mcap", "zstandard", "lz4"),
    example="knotwork replay --check runs/demo/log.mcap",
)
