"""`knotwork map`: what is in a map file, and the map in other formats."""

from knotwork.core.manifest import Manifest

MANIFEST = Manifest(
    name="map",
    kind="command",
    summary="look into a saved map (info), turn it into map.pgm + map.yaml, a picture or outlines (convert)",
    impl="knotwork.plugins.commands.map.command:MapCommand",
    example="knotwork map convert my-map/intel.map --to pgm",
)
