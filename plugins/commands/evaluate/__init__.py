"""`knotwork evaluate`: scores of a trajectory file."""

from knotwork.core.manifest import Manifest

MANIFEST = Manifest(
    name="evaluate",
    kind="command",
    summary="score a trajectory against relations or a reference trajectory",
    impl="knotwork.plugins.commands.evaluate.command:EvaluateCommand",
    example="knotwork evaluate relations runs/intel/trajectory.tum intel.relations.xz --json",
)
