"""The configuration reference: Markdown written from the same models that check a file."""

import json
from collections.abc import Iterable, Iterator
from typing import Any

from pydantic import BaseModel

from knotwork.core.config.model import Manifests, NodeKeys, PipelineKeys
from knotwork.core.config.schema import Schema, model_schema, node_manifests
from knotwork.core.manifest import KINDS, Manifest

_INTRODUCTION = """\
# Configuration reference

Written by `knotwork` from the schemas of the installed plugins: do not edit. All keys are checked; a
misspelt key, a number outside its bounds or a text where a number belongs is an error with its place.

A pipeline file is YAML. `true` and `false` are the only booleans (`on`, `yes` are texts), `1e-3` is a
number, repeated keys and tags are errors.

- `include`: a file or a list of files this one is laid on, relative to it, or `configs:NAME` for one
  that ships with the package. Mappings are merged key by key, anything else is replaced, later wins; a
  node set to null is removed.
- `vars`: values for `${name}`. A variable set to null must be given with `--set vars.name=VALUE`.
- `${name}` is a variable or else an environment variable, `${NAME:-default}` has a default for one that
  is unset or empty, `${env:NAME}` asks the environment only, `$${` is a literal `${`. A reference that is
  the whole value keeps its type. Inside `{ }` and `[ ]` write it in quotes.
- `--set KEY=VALUE` sets one value after all files are merged: `nodes.map.plugin=grid`,
  `nodes.map.resolution.0=0.5`, `nodes.recorder=~` (removes the node), `vars.log=PATH`.
"""

_BOUNDS = (
    ("exclusiveMinimum", "> {}"),
    ("minimum", ">= {}"),
    ("exclusiveMaximum", "< {}"),
    ("maximum", "<= {}"),
)
_TYPES = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
    "null": "null",
    "object": "mapping",
}
_HEADINGS = {
    "driver": "Drivers",
    "map": "Maps",
    "localizer": "Localizers",
    "observer": "Observers",
    "policy": "Policies",
    "sink": "Sinks",
}


def reference(registry: Manifests) -> str:
    """Return the configuration reference of all plugins in `registry` that can be nodes, as Markdown."""
    parts = [_INTRODUCTION, "## Pipeline\n", table(PipelineKeys), "## Every node\n", table(NodeKeys)]
    manifests = node_manifests(registry)
    for kind in KINDS:
        of_kind = [manifest for manifest in manifests if manifest.kind == kind]
        if of_kind:
            parts.append(f"## {_HEADINGS[kind]}\n")
            parts += [plugin(manifest) for manifest in of_kind]
    return "\n".join(part for part in parts if part)


def plugin(manifest: Manifest) -> str:
    """Return the section of one plugin: keys, options, ports, uses, example."""
    text = f"### {manifest.name}\n\n{manifest.summary}\n"
    if manifest.extra:
        text += f"\nNeeds `pip install knotwork[{manifest.extra}]`.\n"
    if keys := table(manifest.config):
        text += f"\n{keys}"
    if manifest.options and (options := table(manifest.options)):
        text += f"\nUnder `options: {{{manifest.name}: ...}}`:\n\n{options}"
    ports = [
        *(_port("input", name, port) for name, port in manifest.inputs.items()),
        *(_port("output", name, port) for name, port in manifest.outputs.items()),
        *(
            ("use", name, use.protocol, "optional" if use.optional else "", use.summary)
            for name, use in manifest.uses.items()
        ),
    ]
    if ports:
        text += "\n" + _markdown(("", "name", "of", "", "meaning"), ports)
    if manifest.provides:
        text += f"\nCan be used as: {', '.join(manifest.provides)}.\n"
    if manifest.example:
        text += f"\n```yaml\n{manifest.example.strip()}\n```\n"
    return text


def _port(direction: str, name: str, port: Any) -> tuple[str, ...]:
    what = f"{port.message} ({port.role})" if port.role else port.message
    traits = [trait for trait in ("optional", "feedback", "many") if getattr(port, trait)]
    return direction, name, "any" if what == "*" else what, ", ".join(traits), port.summary


def table(model: type[BaseModel]) -> str:
    """Return the table of a config model's keys: key, type, unit, default, meaning; "" without keys."""
    rows = [(f"`{key}`", kind, unit, default, meaning) for key, kind, unit, default, meaning in rows_of(model)]
    return _markdown(("key", "type", "unit", "default", "meaning"), rows) if rows else ""


def rows_of(model: type[BaseModel]) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield key, type, unit, default and meaning of each key of a model, nested keys as `camera.fx`."""
    schema = model_schema(model)
    yield from _rows(schema, schema.get("$defs", {}), "", ())


def _rows(
    schema: Schema, defs: dict[str, Schema], prefix: str, within: tuple[str, ...]
) -> Iterator[tuple[str, str, str, str, str]]:
    required = schema.get("required", ())
    for name, own in schema.get("properties", {}).items():
        if "default" in own:
            default = f"`{json.dumps(own['default'], ensure_ascii=False)}`"
        else:
            default = "required" if name in required else ""
        if len(default) > 60:
            default = "see the plugin"
        yield (
            f"{prefix}{name}",
            _type(own, defs),
            str(own.get("unit", "")),
            default,
            own.get("description", ""),
        )
        for suffix, target in _nested(own):
            if target not in within and target in defs:
                yield from _rows(defs[target], defs, f"{prefix}{name}{suffix}.", (*within, target))


def _nested(schema: Schema) -> Iterator[tuple[str, str]]:
    """Yield the definitions a property refers to, with what stands between its name and their keys."""
    if "$ref" in schema:
        yield "", schema["$ref"].rpartition("/")[2]
    for key in ("anyOf", "oneOf", "allOf"):
        for branch in schema.get(key, ()):
            yield from _nested(branch)
    for key, suffix in (("items", "[]"), ("additionalProperties", ".NAME")):
        if isinstance(schema.get(key), dict):
            yield from ((suffix + inner, target) for inner, target in _nested(schema[key]))


def _type(schema: Schema, defs: dict[str, Schema]) -> str:
    if "$ref" in schema:
        target = defs.get(schema["$ref"].rpartition("/")[2], {})
        return _type({**target, "properties": {}}, defs) if "enum" in target else "mapping"
    for key in ("anyOf", "oneOf", "allOf"):
        if key in schema:
            return " or ".join(dict.fromkeys(_type(branch, defs) for branch in schema[key]))
    if "const" in schema:
        return f"`{json.dumps(schema['const'])}`"
    if "enum" in schema:
        return " or ".join(f"`{json.dumps(word)}`" for word in schema["enum"])
    kind = schema.get("type", "any")
    if kind == "array":
        return _list_type(schema, defs)
    bounds = [words.format(_number(schema[key])) for key, words in _BOUNDS if key in schema]
    return f"{_TYPES.get(kind, 'any value')} {' and '.join(bounds)}".strip()


def _list_type(schema: Schema, defs: dict[str, Schema]) -> str:
    low, high = schema.get("minItems"), schema.get("maxItems")
    count = f"{low} " if low == high and low is not None else f"{low} to {high} " if low and high else ""
    inner = schema.get("items") or (schema.get("prefixItems") or [{}])[0]
    return f"list of {count}({_type(inner, defs)})" if isinstance(inner, dict) and inner else f"list of {count}values"


def _number(value: float) -> str:
    return f"{value:g}" if abs(value) < 1e15 else "2^64" if value == 1 << 64 else str(value)


def _markdown(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    cells = [[str(cell).replace("|", "\\|").replace("\n", " ") for cell in line] for line in lines]
    return "".join(f"| {' | '.join(line)} |\n" for line in cells)
