"""Finds plugins: a built-in table and the entry-point group `knotwork.plugins`, both as manifests.

Discovery never fails: a broken or half-installed plugin becomes a record with its cause, and is fatal
only to a pipeline that names it.
"""

import difflib
import importlib
import importlib.util
from collections.abc import Iterable
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any

import pluggy
from pydantic import BaseModel

from knotwork.core import message_types
from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.hooks import PROJECT, Hooks
from knotwork.core.manifest import CONTRACT_VERSION, KINDS, Manifest

GROUP = "knotwork.plugins"


@dataclass(frozen=True, slots=True)
class Record:
    """One discovered plugin, usable or not."""

    name: str
    kind: str
    distribution: str  # "knotwork 0.1.0" or the third party's
    manifest: Manifest | None
    cause: str = ""  # why it cannot be used; empty when it can
    source: str = ""  # where the manifest came from: `package.module` or `package.module:NAME`
    missing: bool = False  # it would work if what `cause` names were installed

    @property
    def state(self) -> str:
        """`ok`, `missing` (something it needs is not installed) or `broken`."""
        if not self.cause:
            return "ok"
        return "missing" if self.missing else "broken"


class Registry:
    """All plugins installed here, by name; of the built-in ones only those asked for are imported."""

    def __init__(self, builtins: Iterable[str] | None = None, third_parties: bool = True) -> None:
        self.hooks = pluggy.PluginManager(PROJECT)
        self.hooks.add_hookspecs(Hooks)
        self._records: dict[str, Record] = {}
        if builtins is None:
            builtins = importlib.import_module("knotwork.plugins").BUILTINS
        self._unread = {module.rpartition(".")[2].replace("_", "-"): module for module in builtins}
        for point in sorted(entry_points(group=GROUP), key=lambda p: p.name) if third_parties else ():
            self._discover(point.name, point, _distribution(point))

    def records(self, kind: str | None = None) -> list[Record]:
        """Return all records of a kind (all kinds without one), in the order of kinds, then names."""
        self._read_all()
        order = {k: i for i, k in enumerate((*KINDS, "?"))}
        chosen = [r for r in self._records.values() if kind is None or r.kind == kind]
        return sorted(chosen, key=lambda r: (order[r.kind], r.name))

    def names(self, kind: str | None = None) -> list[str]:
        """Return the names of usable plugins."""
        return [r.name for r in self.records(kind) if not r.cause]

    def record(self, name: str) -> Record | None:
        """Return what is known of a plugin."""
        self._read(name)
        if name not in self._records:  # a module may hold others than the one it is named after
            self._read_all()
        return self._records.get(name)

    def find(self, name: str) -> Manifest | None:
        """Return a manifest if the plugin can be used."""
        record = self.record(name)
        return record.manifest if record is not None and not record.cause else None

    def why_not(self, name: str) -> str:
        """Return why a plugin cannot be used."""
        record = self.record(name)
        return record.cause if record is not None else ""

    def load(self, manifest: Manifest) -> type[Any]:
        """Import a plugin's implementation.

        Raises
        ------
        InputError
            It cannot be imported; the cause is in the message.
        """
        implementation: type[Any] = load_object(manifest.impl, f"plugin {manifest.name}")
        return implementation

    def nearest(self, name: str) -> str:
        """Return a hint that names the closest plugin, or how to list them."""
        self._read_all()
        close = difflib.get_close_matches(name, self._records, n=1)
        return f"did you mean {close[0]!r}?" if close else "`knotwork plugins` lists them"

    def add(self, manifest: Manifest, distribution: str, source: str = "") -> None:
        """Add one manifest; a name that is taken stays with its first owner."""
        cause = _unusable(manifest)
        missing = not cause and (cause := _missing(manifest)) != ""
        kind = manifest.kind if manifest.kind in KINDS else "?"
        self._read(manifest.name)
        known = self._records.get(manifest.name)
        if known is not None:
            cause, missing = f"the name {manifest.name!r} is taken by {known.distribution}", False
        cause = cause or _register_types(manifest)
        self._keep(Record(str(manifest.name), kind, distribution, manifest, cause, source, missing))

    def _keep(self, record: Record) -> None:
        """Put a record under its name, or under a name that says whose it is when that is taken."""
        self._read(record.name)
        if record.name in self._records:
            record = replace(record, name=f"{record.name} ({record.distribution})")
        self._records[record.name] = record

    def _read(self, name: str) -> None:
        """Import the manifest of a built-in plugin, if that has not been done."""
        module = self._unread.pop(name, None)
        if module is not None:
            self._discover(name, module, f"knotwork {importlib.import_module('knotwork').__version__}")

    def _read_all(self) -> None:
        for name in list(self._unread):
            self._read(name)

    def _discover(self, name: str, source: str | EntryPoint, distribution: str) -> None:
        path = source if isinstance(source, str) else source.value
        # Whatever a stranger's module does while it is imported, the others must stay usable.
        try:
            found = importlib.import_module(source) if isinstance(source, str) else source.load()
            manifests = self._manifests(found)
            if isinstance(found, ModuleType) and not self.hooks.is_registered(found):
                self.hooks.register(found, name=f"{distribution}:{name}")
            for manifest in manifests:
                self.add(manifest, distribution, path)
        except (Exception, SystemExit) as error:  # noqa: BLE001
            self._keep(Record(name, "?", distribution, None, _cause(error), path))

    @staticmethod
    def _manifests(found: Any) -> list[Manifest]:
        if isinstance(found, ModuleType):
            give = getattr(found, "knotwork_manifests", None)
            found = give() if give is not None else getattr(found, "MANIFEST", found)
        manifests: list[Manifest] = []
        for manifest in found if isinstance(found, list | tuple) else [found]:
            if not isinstance(manifest, Manifest):
                raise TypeError(f"expected a knotwork.core.manifest.Manifest, got {type(manifest).__name__}")
            manifests.append(manifest)
        return manifests


def load_object(path: str, whose: str) -> Any:
    """Import `package.module:Name`; any failure becomes one line with its cause."""
    module, _, name = path.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except (Exception, SystemExit) as error:
        raise InputError(f"{path!r} cannot be imported: {_cause(error)}", where=whose) from error


def _unusable(manifest: Any) -> str:
    """Return why a manifest, whatever a stranger put into it, cannot be used."""
    if manifest.kind not in KINDS:
        return f"unknown kind {manifest.kind!r}, expected one of {', '.join(KINDS)}"
    if manifest.contract != CONTRACT_VERSION:
        newer = manifest.contract > CONTRACT_VERSION
        todo = "update knotwork" if newer else "update the plugin"
        return f"written for contract {manifest.contract}, this is contract {CONTRACT_VERSION}: {todo}"
    for model in (manifest.config, manifest.options):
        if model is not None and not _is_model(model):
            return f"config must be a pydantic model class, got {model!r}"
    return ""


def _missing(manifest: Manifest) -> str:
    absent = [name for name in manifest.requires if importlib.util.find_spec(name.partition(".")[0]) is None]
    if not absent:
        return ""
    needed = f"pip install 'knotwork[{manifest.extra}]'" if manifest.extra else f"pip install {' '.join(absent)}"
    return f"needs {', '.join(absent)}: {needed}"


def _register_types(manifest: Manifest) -> str:
    """Make the plugin's message types known; return why that cannot be done."""
    for name, path in manifest.message_types.items():
        try:
            message_types.register(name, path)
        except KnotworkError as error:
            return error.message
    return ""


def _is_model(model: object) -> bool:
    return isinstance(model, type) and issubclass(model, BaseModel)


def _distribution(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist is not None else "unknown distribution"


def _cause(error: BaseException) -> str:
    text = str(error).splitlines()
    return f"{type(error).__name__}: {text[0] if text else ''}".rstrip(": ")
