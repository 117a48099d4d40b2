"""The pluggy hooks: a plugin module gives its manifest, and may watch runs begin and end."""

from typing import TYPE_CHECKING, Any

import pluggy

from knotwork.core.manifest import Manifest

if TYPE_CHECKING:
    from knotwork.core.runtime.run import Run

PROJECT = "knotwork"

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


class Hooks:
    """What a plugin module may implement with `@hookimpl`; none of these is called per message."""

    @hookspec
    def knotwork_manifests(self) -> list[Manifest]:  # type: ignore[empty-body]
        """Give the manifests of this module; without it, its `MANIFEST` is taken."""

    @hookspec
    def knotwork_run_started(self, run: "Run") -> None:
        """See a run before its first event; `run.tap(call)` then gives a tool every message."""

    @hookspec
    def knotwork_run_finished(self, run: "Run", statistics: dict[str, Any]) -> None:
        """See a run after its last event, before its files are closed."""
