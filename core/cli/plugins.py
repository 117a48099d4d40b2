"""`knotwork plugins [NAME]`: what is installed here, without importing any of it."""

import argparse
import json
import sys
from typing import Any

from knotwork.core.errors import InputError
from knotwork.core.manifest import KINDS, Manifest, Port
from knotwork.core.registry import Record, Registry


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add NAME, --kind and --json."""
    parser.add_argument("name", metavar="NAME", nargs="?", help="describe this plugin")
    parser.add_argument("--kind", choices=KINDS, help="only this kind")
    parser.add_argument("--json", action="store_true")


def run(arguments: argparse.Namespace) -> int:
    """Print the table, or one plugin's ports, keys and an example."""
    registry = Registry()
    if arguments.name is None:
        records = registry.records(arguments.kind)
        sys.stdout.write(json.dumps([_row(r) for r in records], indent=2) + "\n" if arguments.json else _table(records))
        return 0
    record = registry.record(arguments.name)
    if record is None:
        raise InputError(f"no plugin {arguments.name!r}", hint=registry.nearest(arguments.name))
    sys.stdout.write(json.dumps(_whole(record), indent=2) + "\n" if arguments.json else describe(record))
    return 0


def _row(record: Record) -> dict[str, Any]:
    summary = record.manifest.summary if record.manifest else ""
    return {
        "name": record.name,
        "kind": record.kind,
        "summary": summary,
        "distribution": record.distribution,
        "state": record.state,
        "cause": record.cause,
    }


def _whole(record: Record) -> dict[str, Any]:
    row = _row(record)
    if record.manifest is not None:
        m = record.manifest
        ports = {"inputs": m.inputs, "outputs": m.outputs}
        row |= {k: {n: _port(p) for n, p in v.items()} for k, v in ports.items()}
        row |= {"uses": {n: u.protocol for n, u in m.uses.items()}, "provides": list(m.provides)}
        row["config"] = m.config.model_json_schema()
        row["options"] = m.options.model_json_schema() if m.options else None
    return row


def _table(records: list[Record]) -> str:
    width = max((len(r.name) for r in records), default=0) + 2
    lines: list[str] = []
    for kind in (*KINDS, "?"):
        chosen = [r for r in records if r.kind == kind]
        if chosen:
            lines.append(f"{kind if kind != '?' else 'broken'}:")
        for record in chosen:
            summary = record.manifest.summary if record.manifest else ""
            state = f"[{record.state}: {record.cause}]" if record.cause else ""
            third = "" if record.distribution.startswith("knotwork ") else f"({record.distribution})"
            lines.append(f"  {record.name:<{width}}" + " ".join(t for t in (summary, third, state) if t))
    return "\n".join(lines) + "\n"


def _port(port: Port) -> str:
    notes = [port.role, "optional" * port.optional, "feedback" * port.feedback, "any number" * port.many]
    noted = ", ".join(n for n in notes if n)
    return f"{port.message} ({noted})" if noted else port.message


def describe(record: Record) -> str:
    """Render one plugin for a terminal."""
    lines = [f"{record.name} ({record.kind}, {record.distribution})"]
    if record.cause:
        lines.append(f"cannot be used: {record.cause}")
    if record.manifest is not None:
        m = record.manifest
        lines.append(m.summary)
        lines += [f"  takes {n}: {_port(p)}  {p.summary}".rstrip() for n, p in m.inputs.items()]
        lines += [f"  gives {n}: {_port(p)}  {p.summary}".rstrip() for n, p in m.outputs.items()]
        lines += [f"  uses {n}: {u.protocol}{' (optional)' * u.optional}" for n, u in m.uses.items()]
        lines += [f"  provides {p}" for p in m.provides]
        lines += _keys("keys:", m.config.model_json_schema())
        if m.options is not None:
            lines += _keys(f"under options: {{{m.name}: ...}}:", m.options.model_json_schema())
        lines += ["example:", *_example(m)]
    return "\n".join(lines) + "\n"


def _keys(title: str, schema: dict[str, Any]) -> list[str]:
    properties = schema.get("properties", {})
    if not properties:
        return []
    required = schema.get("required", [])
    lines = [title]
    for name, field in properties.items():
        unit = f" [{field['unit']}]" if "unit" in field else ""
        default = "required" if name in required else f"default {json.dumps(field.get('default'))}"
        lines.append(f"  {name}: {kind_of(field)}{unit}, {default}")
        if field.get("description"):
            lines.append(f"      {field['description']}")
    return lines


def kind_of(field: dict[str, Any]) -> str:
    """Name the type of a JSON Schema property: `number`, `list of number`, `a | b`."""
    if "enum" in field:
        return " | ".join(json.dumps(v) for v in field["enum"])
    if "const" in field:
        return json.dumps(field["const"])
    if "anyOf" in field:
        return " | ".join(kind_of(f) for f in field["anyOf"])
    if "$ref" in field:
        return str(field["$ref"]).rpartition("/")[2]
    if field.get("type") == "array":
        return f"list of {kind_of(field['items'])}" if isinstance(field.get("items"), dict) else "list"
    return str(field.get("type", "any"))


def _example(manifest: Manifest) -> list[str]:
    if manifest.example:
        return ["  " + line for line in manifest.example.strip("\n").splitlines()]
    if manifest.kind == "command":
        return [f"  knotwork {manifest.name} --help"]
    required = manifest.config.model_json_schema().get("required", [])
    keys = "".join(f", {key}: ..." for key in required)
    return [f"  {manifest.kind}: {{plugin: {manifest.name}{keys}}}"]
