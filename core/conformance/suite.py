"""What every plugin must do, whatever its kind."""

import subprocess
import sys
import typing
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import pytest
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from knotwork.core import message_types
from knotwork.core.conformance.context import RecordingContext
from knotwork.core.conformance.room import FixedPrior
from knotwork.core.conformance.room_map import RoomMap
from knotwork.core.conformance.samples import core_types
from knotwork.core.contracts import Command, Driver, Localizer, Map, Node, Observer, Policy, Sink
from knotwork.core.manifest import CONTRACT_VERSION, KINDS, Manifest, PluginConfig
from knotwork.core.registry import Registry, load_object

BASES: dict[str, type] = {
    "driver": Driver, "map": Map, "localizer": Localizer, "observer": Observer,
    "policy": Policy, "sink": Sink, "command": Command,
}  # fmt: skip

_HEAVY = ("numpy", "scipy", "numba")
_ROOM_MAP = Manifest("room", "map", "the kit's reference map", "knotwork.core.conformance.room_map:RoomMap")


@cache
def installed() -> Registry:
    """Return the registry of everything installed here."""
    return Registry()


class PluginSuite:
    """Base of all suites. A subclass names its plugin; pytest collects it when its name begins with `Test`.

    Attributes
    ----------
    plugin
        Name under which the plugin is installed, or its manifest.
    kind
        Set by each suite.
    config, options
        As they would stand in a pipeline file.
    """

    plugin: ClassVar[str | Manifest]
    kind: ClassVar[str] = ""
    config: ClassVar[dict[str, Any]] = {}
    options: ClassVar[dict[str, Any]] = {}

    # ---- what a subclass may override

    def files(self, folder: Path) -> dict[str, Any]:
        """Make what the plugin needs to find (a log, a world) in `folder`; return config keys that name it."""
        return {}

    def use(self, protocol: str) -> Any:
        """Return something that offers a protocol the plugin uses: here a room's map and a fixed prior."""
        if protocol == "map":
            return RoomMap(RecordingContext(_ROOM_MAP, out=Path()))
        if protocol == "prior":
            return FixedPrior([0.0, 0.0, 0.0])  # type: ignore[arg-type]
        return pytest.fail(f"the plugin uses a {protocol!r}: override `use(self, protocol)` to give one")

    # ---- what the checks are made of

    @property
    def manifest(self) -> Manifest:
        """The manifest under test; fails with the registry's cause when the plugin cannot be used."""
        if isinstance(self.plugin, Manifest):
            return self.plugin
        found = installed().find(self.plugin)
        if found is None:
            cause = installed().why_not(self.plugin) or f"not installed; {installed().nearest(self.plugin)}"
            return pytest.fail(f"plugin {self.plugin!r}: {cause}")
        return found

    def context(self, folder: Path, *, out: Path | None = None, uses: dict[str, Any] | None = None) -> RecordingContext:
        """Return a fresh context with this suite's config; uses that are not given come from `use`."""
        manifest = self.manifest
        if out is None:
            out = folder / "out"
            out.mkdir(parents=True, exist_ok=True)
        inputs = folder / "in"
        inputs.mkdir(parents=True, exist_ok=True)
        given = uses or {}
        needed = {name: given.get(name) or self.use(use.protocol) for name, use in manifest.uses.items()}
        return RecordingContext(
            manifest, self.config | self.files(inputs), options=self.options, uses=needed, out=out
        )  # fmt: skip

    def node(self, context: RecordingContext) -> Any:
        """Build, warm and open a node."""
        node = self.implementation()(context)
        node.warm()
        node.open()
        return node

    def implementation(self) -> type[Any]:
        """Import the plugin's class."""
        found: type[Any] = load_object(self.manifest.impl, f"plugin {self.manifest.name}")
        return found

    # ---- checks of the manifest

    def test_manifest(self) -> None:
        """Name, kind, contract version and summary are as they must be."""
        manifest = self.manifest
        assert manifest.kind in KINDS
        assert manifest.kind == self.kind, f"a {manifest.kind} tried with the suite of a {self.kind}"
        assert manifest.contract == CONTRACT_VERSION, f"written for contract {manifest.contract}"
        assert manifest.name == manifest.name.lower().strip()
        assert " " not in manifest.name
        assert len(manifest.summary.splitlines()) == 1, "the summary is one line"

    def test_manifest_is_light(self) -> None:
        """Importing the manifest imports neither NumPy, SciPy, Numba nor the implementation."""
        module = self._manifest_module()
        implementation = self.manifest.impl.partition(":")[0]
        assert implementation != module, f"the implementation is in the manifest's module {module}"
        code = (
            f"import importlib, sys; importlib.import_module({module!r}); "
            f"print(*[m for m in {(*_HEAVY, implementation)!r} if m in sys.modules])"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert not done.stdout.split(), f"importing {module} imports {done.stdout.strip()}"

    def _manifest_module(self) -> str:
        if isinstance(self.plugin, str):
            record = installed().record(self.plugin)
            if record is not None and record.source:
                return record.source.partition(":")[0]
        module = self.manifest.config.__module__
        if module == PluginConfig.__module__:
            pytest.skip("the manifest is not installed and has no config model: its module is unknown")
        return module

    def test_config(self) -> None:
        """Config models are frozen, refuse unknown keys, describe every key, give every number a unit."""
        manifest = self.manifest
        problems: list[str] = []
        for model in (manifest.config, manifest.options):
            for path, inner in _models(model, ""):
                if not inner.model_config.get("frozen"):
                    problems.append(f"{inner.__name__} is not frozen")
                if inner.model_config.get("extra") != "forbid":
                    problems.append(f"{inner.__name__} takes unknown keys")
                for name, field in inner.model_fields.items():
                    problems += [f"{path}{name} {lack}" for lack in _lacks(field)]
        assert not problems, "; ".join(problems)

    def test_unknown_key_is_refused(self, tmp_path: Path) -> None:
        """A mistyped key is an error, not ignored."""
        keys = self.config | self.files(tmp_path)
        self.manifest.config.model_validate(keys)
        with pytest.raises(ValidationError) as caught:
            self.manifest.config.model_validate(keys | {"no_such_key": 1})
        assert any(error["loc"] == ("no_such_key",) for error in caught.value.errors())

    def test_message_types(self) -> None:
        """Every port's type is known; the plugin's own types load and have a lossless codec."""
        from knotwork.core import codec

        manifest = self.manifest
        known = {*core_types(), *message_types.message_types(), *manifest.message_types}
        known |= {name for r in installed().records() if r.manifest for name in r.manifest.message_types}
        for name, port in manifest.inputs.items():
            assert port.message in known or (port.message == "*" and self.kind == "sink"), f"input {name}"
        for name, port in manifest.outputs.items():
            assert port.message in known, f"output {name} gives {port.message!r}, which no one defines"
            assert port.message != "pose" or port.role, f"output {name} does not say which role its poses have"
        for name, path in manifest.message_types.items():
            cls = load_object(path, f"message type {name}")
            assert cls.type_name == name, f"{path} calls itself {cls.type_name!r}"
            codec.check(cls)

    # ---- checks of the implementation

    def test_implementation(self) -> None:
        """The class is of its kind's base and has a handler for every input."""
        cls = self.implementation()
        assert issubclass(cls, BASES[self.kind]), f"{cls.__name__} is not a {BASES[self.kind].__name__}"
        if self.kind != "sink":
            for port in self.manifest.inputs:
                handler = f"on_{port.replace('-', '_')}"
                assert callable(getattr(cls, handler, None)), f"{cls.__name__} has no {handler}()"


class NodeSuite(PluginSuite):
    """Base of all suites but that of commands."""

    def test_opens_and_closes(self, tmp_path: Path) -> None:
        """A run without a message ends well, and a second close does nothing."""
        context = self.context(tmp_path)
        node: Node = self.node(context)
        node.stop_motion()
        node.finish()
        figures = node.statistics()
        assert all(isinstance(value, int | float) for value in figures.values()), "statistics() gives numbers by name"
        node.close()
        node.close()

    def test_closes_unopened(self, tmp_path: Path) -> None:
        """Another node's failure may end a run before this one was opened."""
        node: Node = self.implementation()(self.context(tmp_path))
        node.stop_motion()
        node.close()


def _models(model: type[BaseModel] | None, path: str) -> Iterator[tuple[str, type[BaseModel]]]:
    if model is None:
        return
    yield path, model
    for name, field in model.model_fields.items():
        for part in _parts(field.annotation):
            if isinstance(part, type) and issubclass(part, BaseModel):
                yield from _models(part, f"{path}{name}.")


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield a type and all it is made of: tuple[float, X] -> tuple, float, X."""
    arguments = typing.get_args(annotation)
    if typing.get_origin(annotation) is typing.Literal:
        return
    if not arguments:
        yield annotation
    for argument in arguments:
        yield from _parts(argument)


def _lacks(field: FieldInfo) -> Iterator[str]:
    if not field.description:
        yield "has no description"
    extra = field.json_schema_extra
    numeric = any(part in (int, float) for part in _parts(field.annotation))
    if numeric and not (isinstance(extra, dict) and extra.get("unit")):
        yield "is a number without a unit (use knotwork.core.manifest.quantity)"
