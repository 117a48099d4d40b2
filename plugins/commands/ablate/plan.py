"""From an ablation file to the runs it asks for, each a checked pipeline."""

import hashlib
import itertools
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from knotwork.core import config, graph
from knotwork.core.config.check import check
from knotwork.core.config.interpolation import interpolate
from knotwork.core.config.overrides import TOP, override
from knotwork.core.config.render import written
from knotwork.core.config.sources import Sources, beside
from knotwork.core.config.tree import Item, Problems, container, plain, short
from knotwork.core.errors import ConfigError
from knotwork.core.registry import Registry
from knotwork.plugins.commands.ablate.metrics import Metric, metric_of
from knotwork.plugins.commands.ablate.model import MAX_RUNS, AblationKeys, NamedValue

_OWN = ("include", "vars")


@dataclass(frozen=True, slots=True)
class Value:
    """One value of an axis: its name in the table, what it sets, what its runs are scored against."""

    name: str
    changes: tuple[config.Change, ...]
    relations: str = ""
    reference: str = ""


@dataclass(frozen=True, slots=True)
class Run:
    """One pipeline to run.

    Attributes
    ----------
    names
        Name of the value by axis.
    digest
        Of the resolved configuration and the versions of what it runs: equal runs give equal results.
    """

    names: dict[str, str]
    pipeline: config.Pipeline
    digest: str
    relations: str = ""
    reference: str = ""

    @property
    def title(self) -> str:
        """Return the names of its values."""
        return ", ".join(self.names.values())


@dataclass(frozen=True, slots=True)
class Plan:
    """An ablation, checked."""

    name: str
    description: str
    base: str
    axes: dict[str, list[str]]  # names of the values
    average: tuple[str, ...]
    metrics: list[Metric]
    runs: list[Run] = field(repr=False)


def read_plan(
    path: str, registry: Registry, overrides: Iterable[str] = (), environment: Mapping[str, str] = os.environ
) -> Plan:
    """Read an ablation file and check every run it asks for as `knotwork validate` would.

    Parameters
    ----------
    path
        The file, or `configs:ablations/NAME`.
    overrides
        Arguments `KEY=VALUE`: `vars.NAME` of this file, any other key in every run.

    Raises
    ------
    ConfigError
        With every problem of the file and of all runs.
    """
    problems = Problems()
    root = Sources(problems, "an ablation", "`ablation:`, `base:` and `axes:`").gather(path)
    own, others = _divide(root, overrides)
    for argument in own:
        root = override(root, argument, problems)
    root = interpolate(root, environment, problems)
    entries = {name: item for name, item in root.mapping().items() if name not in _OWN}
    keys = check(AblationKeys, container(entries, root.where), (), problems, label="an ablation", also=_OWN)
    problems.check()
    assert keys is not None  # else there was a problem
    common = _changes(root.child("set"), problems, "set")
    axes = {name: _axis(name, item, problems) for name, item in _mapping(root, "axes").items()}
    metrics = _metrics(root.child("metrics"), keys.metrics, problems)
    for index, name in enumerate(keys.average):
        if name not in axes:
            where = root.nearest(("average", index)).where
            problems.add(where, f"average.{index}", f"there is no axis {short(name)}", problems.nearest(name, axes))
    count = 1
    for values in axes.values():
        count *= len(values)
    if count > MAX_RUNS:
        problems.add(_mapping_place(root, "axes"), "axes", f"{count} runs, expected {MAX_RUNS} or fewer")
    problems.check()
    runs = _runs(beside(path, keys.base), registry, common, axes, others, environment, root.nearest(("base",)).where)
    names = {axis: [value.name for value in values] for axis, values in axes.items()}
    return Plan(keys.ablation, keys.description, keys.base, names, tuple(keys.average), metrics, runs)


def _divide(root: Item, overrides: Iterable[str]) -> tuple[list[str], list[str]]:
    """Tell arguments for this file's variables from those for the pipelines."""
    variables = root.child("vars")
    declared = {f"vars.{name}" for name in variables.mapping()} if variables else set()
    own: list[str] = []
    others: list[str] = []
    for argument in overrides:
        (own if argument.partition("=")[0].strip() in declared else others).append(argument)
    return own, others


def _mapping(root: Item, name: str) -> dict[str, Item]:
    item = root.child(name)
    return item.mapping() if item is not None else {}


def _mapping_place(root: Item, name: str) -> str:
    item = root.child(name)
    return item.position if item is not None else root.where


def _changes(section: Item | None, problems: Problems, path: str) -> tuple[config.Change, ...]:
    """Return what a `set` mapping sets; its keys are dotted."""
    changes = []
    for key, item in section.mapping().items() if section is not None else ():
        where = item.key or item.where
        if key.partition(".")[0] not in TOP:
            hint = problems.nearest(key.partition(".")[0], TOP)
            problems.add(where, f"{path}.{key}", f"{short(key)} is no config key", hint)
        else:
            changes.append(config.Change(key, item, where))
    return tuple(changes)


def _axis(name: str, section: Item, problems: Problems) -> list[Value]:
    """Return the values of one axis."""
    values: dict[str, Value] = {}
    entries = section.value if isinstance(section.value, list) else []
    if not entries and not section.broken:
        problems.add(section.position, f"axes.{name}", "an axis needs at least one value")
    for index, item in enumerate(entries):
        path = f"axes.{name}.{index}"
        value = _named(item, path, problems) if "name" in item.mapping() else _plain(name, section, item, problems)
        if value is not None and value.name in values:
            problems.add(item.where, path, f"the value {short(value.name)} is there twice")
        elif value is not None:
            values[value.name] = value
    return list(values.values())


def _named(item: Item, path: str, problems: Problems) -> Value | None:
    keys = check(NamedValue, item, tuple(path.split(".")), problems, label="a value of an axis")
    changes = _changes(item.child("set"), problems, f"{path}.set")
    return None if keys is None else Value(keys.name, changes, keys.relations, keys.reference)


def _plain(axis: str, section: Item, item: Item, problems: Problems) -> Value | None:
    """Return a value of an axis whose name is the key it sets."""
    top, dot, _ = axis.partition(".")
    if not (axis == "seed" or (top in ("nodes", "vars") and dot)):
        where = item.where if isinstance(item.value, dict) else section.key or section.where
        message = f"{short(axis)} is no config key, so each of its values needs a `name:` and what it sets"
        near = problems.nearest(top, ("nodes", "vars", "seed"))
        hint = near if near.startswith("did you mean") else "{name: NAME, set: {nodes.map.plugin: ...}}"
        problems.add(where, f"axes.{axis}", message, hint)
        return None
    data = plain(item)
    name = written(data) if not isinstance(data, dict) else json.dumps(data)
    return Value(name[:100], (config.Change(axis, item, item.where),))


def _metrics(section: Item | None, names: list[Any], problems: Problems) -> list[Metric]:
    metrics = []
    for index, name in enumerate(names):
        item = section.child(index) if section is not None else None
        metric = metric_of(name, item or Item(name, "default"), f"metrics.{index}", problems)
        if metric is not None:
            metrics.append(metric)
    return metrics


def _runs(
    base: str,
    registry: Registry,
    common: tuple[config.Change, ...],
    axes: dict[str, list[Value]],
    overrides: list[str],
    environment: Mapping[str, str],
    where: str,
) -> list[Run]:
    """Load and wire the pipeline of every combination, the last axis changing fastest."""
    found = Problems()
    runs: list[Run] = []
    for values in itertools.product(*axes.values()):
        changes = [*common, *(change for value in values for change in value.changes)]
        try:
            pipeline = config.load(base, registry, overrides, environment, changes)
            graph.build(pipeline)
        except ConfigError as error:
            for one in error.problems:
                at = f"{where}: {one.where}" if one.where == base else one.where
                found.add(at, one.path, one.message, one.hint)
            continue
        runs.append(
            Run(
                dict(zip(axes, (value.name for value in values), strict=True)),
                pipeline,
                digest(pipeline, registry),
                next((value.relations for value in values if value.relations), ""),
                next((value.reference for value in values if value.reference), ""),
            )
        )
    found.check()
    return runs


def digest(pipeline: config.Pipeline, registry: Registry) -> str:
    """Return a digest of what decides the result of a run: resolved configuration and versions."""
    records = (registry.record(node.plugin) for node in pipeline.nodes.values())
    distributions = sorted({record.distribution for record in records if record is not None})
    versions = [version_of("numpy"), version_of("numba"), *distributions]
    text = json.dumps([pipeline.resolved, versions], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def version_of(name: str) -> str:
    """Return `name version`."""
    try:
        return f"{name} {version(name)}"
    except PackageNotFoundError:
        return f"{name} not installed"
