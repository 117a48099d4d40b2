"""JSON Schema (draft 2020-12) of a pipeline file, complete for the plugins that are installed."""

from typing import Any

from pydantic import BaseModel
from pydantic.errors import PydanticUserError
from pydantic.json_schema import GenerateJsonSchema

from knotwork.core.config.model import NAME, Manifests, NodeKeys, PipelineKeys
from knotwork.core.manifest import Manifest, PluginConfig

Schema = dict[str, Any]

DRAFT = "https://json-schema.org/draft/2020-12/schema"
REFERENCE: Schema = {"$ref": "#/$defs/reference"}

_ABOUT = ("title", "description", "default", "examples", "unit", "deprecated")


class _Generator(GenerateJsonSchema):
    """Says nothing of defaults that JSON cannot hold; they are left out."""

    ignored_warning_kinds = {"skipped-choice", "non-serializable-default"}  # noqa: RUF012


def model_schema(model: type[BaseModel], prefix: str = "") -> Schema:
    """Return the schema of a config model; references to its `$defs` carry `prefix`.

    A model that has no schema (a field of a free Python type) is described as any mapping.
    """
    template = f"#/$defs/{prefix}{{model}}"
    try:
        return model.model_json_schema(ref_template=template, schema_generator=_Generator)
    except PydanticUserError:
        return {"type": "object", "properties": {name: {} for name in model.model_fields}}


def json_schema(registry: Manifests) -> Schema:
    """Return the JSON Schema of a pipeline file for the plugins of `registry`.

    An editor completes and checks every plugin's keys with it. Wherever a value is expected a
    reference such as `${name}` is allowed too. In a file that includes others, keys that those may
    give (`pipeline`, `plugin`) are not required.
    """
    defs: dict[str, Schema] = {
        "reference": {
            "type": "string",
            "pattern": r"\$\{",
            "description": "a reference: ${name}, ${NAME:-default}",
        }
    }
    manifests = node_manifests(registry)
    for manifest in manifests:
        defs[f"node.{manifest.name}"] = _plugin(manifest, manifests, defs)
    head = _referable(model_schema(PipelineKeys))
    required = head.pop("required", [])
    node: Schema = {
        "type": "object",
        "properties": {
            "plugin": _or_reference(
                {"enum": [manifest.name for manifest in manifests], "description": "name of the plugin"}
            )
        },
        "allOf": [
            {
                "if": {"properties": {"plugin": {"const": manifest.name}}, "required": ["plugin"]},
                "then": {"$ref": f"#/$defs/node.{manifest.name}"},
            }
            for manifest in manifests
        ],
    }
    name = NAME.strip("^$")
    properties = {
        **head["properties"],
        "include": {
            "description": "files this one is laid on, relative to it, or configs:NAME for a shipped one",
            "anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}],
        },
        "vars": {
            "description": "values for ${name}; null: must be given with --set vars.name=VALUE",
            "type": ["object", "null"],
            "patternProperties": {f"^{name}$": {}},
            "additionalProperties": False,
        },
        "nodes": {
            "description": "the nodes by name",
            "type": ["object", "null", "string"],
            "patternProperties": {f"^{name}$": {"anyOf": [node, {"type": "null"}, REFERENCE]}},
            "additionalProperties": False,
        },
    }
    whole_node = {
        "type": ["object", "string"],
        "required": ["plugin"],
        "allOf": [
            {
                "if": {"properties": {"plugin": {"const": manifest.name}}, "required": ["plugin"]},
                "then": {"required": needed},
            }
            for manifest in manifests
            if (needed := model_schema(manifest.config).get("required"))
        ],
    }
    whole_nodes = {"type": ["object", "string"], "minProperties": 1, "additionalProperties": whole_node}
    complete = {"required": [*required, "nodes"], "properties": {"nodes": whole_nodes}}
    return {
        "$schema": DRAFT,
        "title": "Knotwork pipeline",
        "type": "object",
        "properties": properties,
        "additionalProperties": False,
        "if": {"not": {"required": ["include"]}},
        "then": complete,
        "$defs": defs,
    }


def node_manifests(registry: Manifests) -> list[Manifest]:
    """Return the manifests of the plugins that can be nodes, by name."""
    found = (registry.find(name) for name in sorted(set(registry.names())))
    return [manifest for manifest in found if manifest is not None and manifest.kind != "command"]


def _plugin(manifest: Manifest, manifests: list[Manifest], defs: dict[str, Schema]) -> Schema:
    """Return the schema of a node of one plugin; definitions its models need go to `defs`."""
    own = _hoisted(manifest.config, f"{manifest.name}.", defs)
    keys = _hoisted(NodeKeys, "framework.", defs)["properties"]
    blocks: dict[str, Schema] = {}
    for other in manifests:
        if other.kind == manifest.kind:
            block = f"{other.name}.options"
            if block not in defs:
                defs[block] = _hoisted(other.options or PluginConfig, f"{block}.", defs)
            blocks[other.name] = {"$ref": f"#/$defs/{block}"}
    text = {"anyOf": [{"type": "string"}, {"type": "null"}]}
    inputs = {"anyOf": [*text["anyOf"], {"type": "array", "items": {"type": "string"}}]}
    keys["plugin"] = {"const": manifest.name, "description": f"{manifest.kind}: {manifest.summary}"}
    keys["uses"] = _named(
        keys["uses"], {use: (text, one.summary or one.protocol) for use, one in manifest.uses.items()}
    )
    keys["inputs"] = _named(
        keys["inputs"], {port: (inputs, one.summary or one.message) for port, one in manifest.inputs.items()}
    )
    keys["options"] = {
        "description": keys["options"]["description"],
        "type": "object",
        "properties": blocks,
        "additionalProperties": False,
    }
    schema: Schema = {
        "type": "object",
        "description": manifest.summary,
        "properties": {**keys, **own.get("properties", {})},
        "additionalProperties": own.get("additionalProperties", True),
    }
    return schema


def _named(key: Schema, entries: dict[str, tuple[Schema, str]]) -> Schema:
    properties = {name: {"description": text, **schema} for name, (schema, text) in entries.items()}
    described = {"type": "object", "properties": properties, "additionalProperties": False}
    return {"description": key["description"], "anyOf": [described, REFERENCE]}


def _hoisted(model: type[BaseModel], prefix: str, defs: dict[str, Schema]) -> Schema:
    schema = model_schema(model, prefix)
    for name, inner in schema.pop("$defs", {}).items():
        defs[prefix + name] = _referable(inner)
    return _referable(schema)


def _referable(schema: Schema) -> Schema:
    """Return the schema with every value below it allowed to be a reference."""
    result = dict(schema)
    if "properties" in result:
        result["properties"] = {name: _or_reference(inner) for name, inner in result["properties"].items()}
    for key in ("items", "additionalProperties"):
        if isinstance(result.get(key), dict):
            result[key] = _or_reference(result[key])
    if "prefixItems" in result:
        result["prefixItems"] = [_or_reference(inner) for inner in result["prefixItems"]]
    for key in ("anyOf", "oneOf", "allOf"):
        if key in result:
            result[key] = [_referable(inner) for inner in result[key]]
    return result


def _or_reference(schema: Schema) -> Schema:
    inner = _referable(schema)
    about = {key: inner.pop(key) for key in _ABOUT if key in inner}
    if unit := about.get("unit"):
        about["description"] = f"[{unit}] {about.get('description', '')}".strip()
    about.pop("title", None)
    if not inner or inner == {"type": "string"}:
        return {**inner, **about}
    branches = inner["anyOf"] if set(inner) == {"anyOf"} else [inner]
    return {**about, "anyOf": [*branches, REFERENCE]}
