"""`knotwork view FILE`: a log in the live page, to play, pause, step and seek."""

from knotwork.core.manifest import Manifest

MANIFEST = Manifest(
    name="view",
    kind="command",
    summary="play a log in the browser",
    impl="knotwork.plugins.commands.view.command:View",
    requires=("PIL",),
)
