"""What pytest loads in every session (entry point `pytest11`): fixtures, and nothing heavy."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from knotwork.core.conformance import ClosedRegistry, RecordingContext
    from knotwork.core.manifest import Manifest

# A failing check then shows the values it compared.
pytest.register_assert_rewrite(
    *(
        f"knotwork.core.conformance.{kind}_suite"
        for kind in ("command", "driver", "localizer", "map", "sink", "stream")
    ),
    "knotwork.core.conformance.suite",
)


@pytest.fixture
def knotwork_context(tmp_path: Path) -> "Callable[..., RecordingContext]":
    """Make recording contexts: `knotwork_context(MANIFEST, {"speed": 0.2}, uses={...})`.

    The arguments are those of `knotwork.core.conformance.RecordingContext`; `out` is a fresh folder
    unless given.
    """
    from knotwork.core.conformance import RecordingContext

    def make(manifest: "Manifest", config: dict[str, Any] | None = None, **rest: Any) -> RecordingContext:
        folder = tmp_path / "out"
        folder.mkdir(exist_ok=True)
        return RecordingContext(manifest, config, **({"out": folder} | rest))

    return make


@pytest.fixture
def knotwork_registry() -> "Callable[..., ClosedRegistry]":
    """Make registries that hold just the manifests given: `knotwork_registry(MANIFEST, ...)`."""
    from knotwork.core.conformance import ClosedRegistry

    return ClosedRegistry
