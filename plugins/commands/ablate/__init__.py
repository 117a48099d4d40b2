"""`knotwork ablate`: one pipeline in many variants, side by side."""

from knotwork.core.manifest import Manifest

MANIFEST = Manifest(
    name="ablate",
    kind="command",
    summary="run a pipeline in many variants and compare them in a table and a report",
    impl="knotwork.plugins.commands.ablate.command:Ablate",
    example="knotwork ablate configs:ablations/maps --out maps",
)
