"""A registry that looks at nothing that is installed."""

from knotwork.core.manifest import Manifest
from knotwork.core.registry import Registry


class ClosedRegistry(Registry):
    """Holds the manifests it is given and refuses discovery: what a test sees does not depend on the machine."""

    def __init__(self, *manifests: Manifest) -> None:
        super().__init__(builtins=(), third_parties=False)
        for manifest in manifests:
            self.add(manifest, "test 0")
