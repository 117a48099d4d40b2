"""From files, arguments and environment to a checked pipeline."""

import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path as FilePath
from typing import Any

from pydantic import BaseModel

from knotwork.core.config.check import check
from knotwork.core.config.interpolation import interpolate
from knotwork.core.config.model import (
    NAME,
    RESERVED,
    Manifests,
    NodeKeys,
    NodeSpec,
    Origin,
    Pipeline,
    PipelineKeys,
)
from knotwork.core.config.overrides import Change, change, override
from knotwork.core.config.sources import Sources
from knotwork.core.config.tree import Item, Path, Problems, container, dotted, short
from knotwork.core.errors import KnotworkError
from knotwork.core.manifest import Manifest, PluginConfig

_NAME = re.compile(NAME)


def load(
    path: str | FilePath,
    registry: Manifests,
    overrides: Iterable[str] = (),
    environment: Mapping[str, str] = os.environ,
    changes: Iterable[Change] = (),
) -> Pipeline:
    """Load a pipeline file.

    Parameters
    ----------
    path
        The file, or `configs:NAME` for one that ships with the package.
    registry
        The plugins that are installed.
    overrides
        Arguments `KEY=VALUE`, applied in order after all files are merged.
    environment
        Where `${NAME}` looks after the file's `vars`.
    changes
        Values from another file (an ablation's), applied in order before `overrides`.

    Raises
    ------
    ConfigError
        With every problem that was found.
    """
    problems = Problems()
    root = Sources(problems).gather(str(path))
    for one in changes:
        root = change(root, one, problems)
    for argument in overrides:
        root = override(root, argument, problems)
    root = interpolate(root, environment, problems)
    return _Resolution(root, registry, problems, str(path)).pipeline()


class _Resolution:
    def __init__(self, root: Item, registry: Manifests, problems: Problems, path: str) -> None:
        self.root = root
        self.registry = registry
        self.problems = problems
        self.path = path
        self.manifests: dict[str, Manifest] = {}  # by node, of those whose plugin is known

    def pipeline(self) -> Pipeline:
        keys = self._head()
        entries = self._nodes()
        for name, item in entries.items():
            self._find_plugin(name, item)
        nodes = {name: spec for name, item in entries.items() if (spec := self._node(name, item, entries))}
        self.problems.check()
        assert keys is not None  # else there was a problem
        resolved = _resolved(keys, nodes)
        return Pipeline(
            name=keys.pipeline,
            description=keys.description,
            clock=keys.clock,
            rate=keys.rate,
            seed=keys.seed,
            nodes=nodes,
            resolved=resolved,
            origins=_origins(resolved, self.root, nodes),
            places={dotted(place): item.position for place, item in self.root.walk()},
            path=self.path,
        )

    def _head(self) -> PipelineKeys | None:
        sections = ("include", "vars", "nodes")
        own = {name: item for name, item in self.root.mapping().items() if name not in sections}
        head = container(own, self.root.where)
        declared = self.root.child("vars")
        if declared and not declared.broken:
            if not isinstance(declared.value, dict):
                self.problems.add(declared.where, "vars", f"expected a mapping, got {short(declared.value)}")
            for name, item in declared.mapping().items():
                self._check_name("variable", name, item, ("vars", name))
        return check(PipelineKeys, head, (), self.problems, label="a pipeline", also=sections)

    def _nodes(self) -> dict[str, Item]:
        item = self.root.child("nodes")
        if item is None or (not item.broken and not item.value):
            where = item.position if item else self.root.where
            self.problems.add(where, "nodes", "a pipeline needs at least one node", "nodes: {log: {plugin: NAME}}")
            return {}
        if not isinstance(item.value, dict) and not item.broken:
            self.problems.add(item.where, "nodes", f"expected a mapping of nodes by name, got {short(item.value)}")
        for name, node in item.mapping().items():
            self._check_name("node", name, node, ("nodes", name))
        return item.mapping()

    def _check_name(self, what: str, name: str, item: Item, path: Path) -> None:
        if not _NAME.match(name) or len(name) > 100:
            message = f"{short(name)} is no name of a {what}"
            self.problems.add(item.key or item.where, path, message, "letters, digits, '_' and '-', no digit first")

    def _find_plugin(self, name: str, item: Item) -> None:
        path = ("nodes", name)
        if not isinstance(item.value, dict):
            if not item.broken:
                message = f"expected a mapping with `plugin:`, got {short(item.value)}"
                self.problems.add(item.where, path, message, "write {plugin: NAME}")
            return
        plugin = item.value.get("plugin")
        if plugin is None:
            self.problems.add(item.position, (*path, "plugin"), "missing, expected the name of the node's plugin")
        elif isinstance(plugin.value, str):
            manifest = self.registry.find(plugin.value)
            if manifest is None:
                self._no_plugin(plugin, (*path, "plugin"))
            elif manifest.kind == "command":
                message = f"{plugin.value!r} is a command, not a node"
                self.problems.add(plugin.where, (*path, "plugin"), message, f"knotwork {plugin.value}")
            elif clash := RESERVED & set(manifest.config.model_fields):
                keys = ", ".join(sorted(clash))
                message = f"the plugin {plugin.value!r} has a config key that is reserved: {keys}"
                self.problems.add(plugin.where, (*path, "plugin"), message, "its author must rename it")
            else:
                self.manifests[name] = manifest
        elif not plugin.broken:
            message = f"expected the name of a plugin, got {short(plugin.value)}"
            self.problems.add(plugin.where, (*path, "plugin"), message)

    def _no_plugin(self, item: Item, path: Path) -> None:
        name = str(item.value)
        if cause := self.registry.why_not(name):
            self.problems.add(item.where, path, f"the plugin {name!r} cannot be used: {cause}")
        else:
            hint = self.problems.nearest(name, self._node_plugins())
            self.problems.add(item.where, path, f"there is no plugin {short(name)}", hint)

    def _node_plugins(self) -> list[str]:
        commands = set(self.registry.names("command"))
        return [name for name in self.registry.names() if name not in commands]

    def _node(self, name: str, item: Item, entries: dict[str, Item]) -> NodeSpec | None:
        manifest = self.manifests.get(name)
        if not isinstance(item.value, dict):
            return None
        path = ("nodes", name)
        keys = self._framework_keys(item, path, manifest)
        if keys is not None:
            self._check_uses(item, path, manifest, entries)
            self._check_inputs(item, path, manifest, entries)
        options = self._options(item, path, manifest)
        if manifest is None:
            return None
        own = {key: child for key, child in item.value.items() if key not in RESERVED}
        label = f"plugin {manifest.name!r}"
        config = check(
            manifest.config,
            container(own, item.where, key=item.key),
            path,
            self.problems,
            label=label,
            also=RESERVED,
        )
        if keys is None or config is None:
            return None
        try:
            manifest = manifest.of(config)
        except KnotworkError as error:
            self.problems.add(item.position, path, str(error))
            return None
        return NodeSpec(
            name=name,
            plugin=manifest.name,
            manifest=manifest,
            config=config,
            options=options,
            uses=keys.uses,
            inputs={port: (one,) if isinstance(one, str) else tuple(one) for port, one in keys.inputs.items()},
            queue=keys.queue,
        )

    def _framework_keys(self, item: Item, path: Path, manifest: Manifest | None) -> NodeKeys | None:
        reserved = {key: child for key, child in item.mapping().items() if key in RESERVED}
        for key in ("uses", "inputs"):  # null takes an entry of an included file back
            if (section := reserved.get(key)) and isinstance(section.value, dict):
                left = {one: child for one, child in section.value.items() if child.value is not None or child.broken}
                reserved[key] = container(left, section.where, key=section.key)
        if (options := reserved.get("options")) and isinstance(options.value, dict):
            blocks = {one: child for one, child in options.value.items() if isinstance(child.value, dict)}
            reserved["options"] = container(blocks, options.where, key=options.key)  # others: see _options
        if manifest is None:  # said already
            reserved["plugin"] = Item("unknown", item.where)
        return check(NodeKeys, container(reserved, item.where, key=item.key), path, self.problems)

    def _check_uses(self, item: Item, path: Path, manifest: Manifest | None, entries: dict[str, Item]) -> None:
        section = item.child("uses")
        for use, child in (section.mapping() if section else {}).items():
            below = (*path, "uses", use)
            if manifest and use not in manifest.uses:
                hint = self.problems.nearest(use, manifest.uses) or "it uses no other node"
                self.problems.add(child.key or child.where, below, f"plugin {manifest.name!r} has no use {use!r}", hint)
            if isinstance(child.value, str) and child.value not in entries:
                hint = self.problems.nearest(child.value, entries)
                self.problems.add(child.where, below, f"there is no node {short(child.value)}", hint)

    def _check_inputs(self, item: Item, path: Path, manifest: Manifest | None, entries: dict[str, Item]) -> None:
        section = item.child("inputs")
        for port, child in (section.mapping() if section else {}).items():
            below = (*path, "inputs", port)
            if manifest and port not in manifest.inputs:
                hint = self.problems.nearest(port, manifest.inputs) or "it takes no messages"
                message = f"plugin {manifest.name!r} has no input {port!r}"
                self.problems.add(child.key or child.where, below, message, hint)
            for producer in child.value if isinstance(child.value, list) else [child]:
                if isinstance(producer.value, str):
                    self._check_producer(producer, below, entries)

    def _check_producer(self, item: Item, path: Path, entries: dict[str, Item]) -> None:
        node, dot, port = str(item.value).partition(".")
        if node not in entries:
            hint = self.problems.nearest(node, entries)
            self.problems.add(item.where, path, f"there is no node {short(node)}", hint)
            return
        manifest = self.manifests.get(node)
        if manifest is None:
            return
        if manifest.ports:
            return  # known with its config; the graph looks
        if not manifest.outputs:
            self.problems.add(item.where, path, f"node {node!r} ({manifest.name}) gives no messages")
        elif dot and port not in manifest.outputs:
            hint = self.problems.nearest(port, manifest.outputs)
            self.problems.add(item.where, path, f"node {node!r} ({manifest.name}) has no output {short(port)}", hint)

    def _options(self, item: Item, path: Path, manifest: Manifest | None) -> BaseModel | None:
        """Check every block against its own plugin; return the chosen plugin's."""
        section = item.child("options")
        blocks = dict(section.mapping()) if section else {}
        if manifest and manifest.options and manifest.name not in blocks:
            blocks[manifest.name] = container({}, item.where, key=item.key)
        chosen: BaseModel | None = None
        for name, block in blocks.items():
            below = (*path, "options", name)
            other = self.registry.find(name)
            if block.broken:
                continue
            if not isinstance(block.value, dict):
                self.problems.add(block.where, below, f"expected a mapping of options, got {short(block.value)}")
            elif other is None:
                if not self.registry.why_not(name):  # a backend that is not usable here is not looked at
                    hint = self.problems.nearest(name, self.registry.names(manifest.kind if manifest else None))
                    self.problems.add(block.key or block.where, below, f"there is no plugin {short(name)}", hint)
            elif manifest and other.kind != manifest.kind:
                message = f"{name!r} is a {other.kind}, this node is a {manifest.kind}"
                self.problems.add(block.key or block.where, below, message)
            else:
                options = check(
                    other.options or PluginConfig, block, below, self.problems, label=f"options of {name!r}"
                )
                if manifest and name == manifest.name and manifest.options:
                    chosen = options
        return chosen


def _resolved(keys: PipelineKeys, nodes: dict[str, NodeSpec]) -> dict[str, Any]:
    data: dict[str, Any] = _data(keys)
    data["nodes"] = {}
    for name, spec in nodes.items():
        node: dict[str, Any] = {"plugin": spec.plugin}
        if spec.uses:
            node["uses"] = dict(spec.uses)
        if spec.inputs:
            node["inputs"] = {port: one[0] if len(one) == 1 else list(one) for port, one in spec.inputs.items()}
        node.update(_data(spec.config))
        if spec.options is not None and (options := _data(spec.options)):
            node["options"] = {spec.plugin: options}
        if spec.queue is not None:
            node["queue"] = _data(spec.queue)
        data["nodes"][name] = node
    return data


def _data(model: BaseModel) -> dict[str, Any]:
    data: dict[str, Any] = _escaped(model.model_dump(mode="json", by_alias=True))
    return data


def _escaped(value: Any) -> Any:
    if isinstance(value, str):
        return value.replace("${", "$${")
    if isinstance(value, dict):
        return {name: _escaped(child) for name, child in value.items()}
    return [_escaped(child) for child in value] if isinstance(value, list) else value


def _origins(resolved: dict[str, Any], root: Item, nodes: dict[str, NodeSpec]) -> dict[str, Origin]:
    origins: dict[str, Origin] = {}

    def visit(value: Any, path: Path, item: Item | None, via: tuple[str, ...]) -> None:
        if item is not None:
            via = item.via or via  # what stands in a list from a variable came through it too
            origins[dotted(path)] = Origin(item.position, via)
        else:
            of_plugin = len(path) > 2 and path[0] == "nodes" and path[2] != "queue"
            origins[dotted(path)] = Origin(f"default of {nodes[str(path[1])].plugin}" if of_plugin else "default")
        inner: Any = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for part, child in inner:
            visit(child, (*path, part), item.child(part) if item is not None else None, via)

    visit(resolved, (), root, ())
    return origins
