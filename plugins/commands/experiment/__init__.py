"""`knotwork experiment`."""

from knotwork.core.manifest import Manifest

MANIFEST = Manifest(
    name="experiment",
    kind="command",
    summary="reproduce published figures",
    impl="knotwork.plugins.commands.experiment.command:Experiment",
)
