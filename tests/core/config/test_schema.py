"""The exported schema, judged by jsonschema, against what the loader itself accepts."""

import json

import jsonschema
import pytest
import yaml

from knotwork.core.config import json_schema, load
from knotwork.core.errors import ConfigError


@pytest.fixture(scope="module")
def validator(shelf):
    schema = json_schema(shelf)
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def findings(validator, text):
    return list(validator.iter_errors(yaml.safe_load(text)))


GOOD = {
    "valid": ("", ""),
    "swapped": ("plugin: spline-surface", "plugin: grid"),
    "reference to a list": ("[0.30, 0.125, 0.05]", "${far}"),
    "reference in a list": ("0.125", "'${far}'"),
    "reference as a boolean": ("range_max:", "fuse: ${env:F:-true}\n    range_max:"),
    "reference as a plugin": ("plugin: ekf", 'plugin: "${P}"'),
    "reference as a word": ("policy: block", 'policy: "${P}"'),
    "rate": ("rate: max", "rate: 2.5"),
    "include": ("pipeline: intel-surface", "include: [a.yaml]"),
    "include one": ("pipeline: intel-surface", "include: configs:a"),
    "several producers": ("scan: log.scan", "scan: [log.scan, log]"),
    "worker": ("{plugin: ekf}", "{plugin: ekf, worker: true}"),
    "nested": (
        "{plugin: ekf}",
        "{plugin: rig, mount: {x: 1}, mounts: {a: {yaw: 2}}, beams: [{x: 1}], limit: null}",
    ),
}


@pytest.mark.parametrize("name", GOOD)
def test_good_files(name, validator, valid):
    old, new = GOOD[name]
    assert old in valid
    assert findings(validator, valid.replace(old, new, 1)) == []


BAD = {
    "unknown top key": ("clock: replay", "clok: replay"),
    "unknown plugin": ("plugin: ekf", "plugin: efk"),
    "no plugin": ("{plugin: ekf}", "{noise: 1}"),
    "unknown key": ("range_max:", "range_mx:"),
    "bound": ("range_max: ${far}", "range_max: -1"),
    "element": ("0.125", "-0.125"),
    "type": ("range_max: ${far}", "range_max: far"),
    "word": ("clock: replay", "clock: reply"),
    "missing": (', path: "${log}"', ""),
    "use": ("{map: map,", "{mpa: map,"),
    "input": ("{scan: log", "{scn: log"),
    "options of nobody": ("grid: {kernel: nearest}", "gird: {}"),
    "options of one that has none": ("{plugin: ekf}", "{plugin: ekf, options: {ekf: {x: 1}}}"),
    "options of another kind": ("grid: {kernel: nearest}", "carmen: {}"),
    "options key": ("{degree: 2}", "{degre: 2}"),
    "options word": ("kernel: nearest", "kernel: linear"),
    "queue": ("policy: block", "policy: drop"),
    "node name": ("  prior: {", "  pri.or: {"),
    "no name": ("pipeline: intel-surface\n", ""),
    "nested": ("{plugin: ekf}", "{plugin: rig, mounts: {a: {yw: 2}}}"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_bad_for_both(name, validator, valid, shelf, write):
    old, new = BAD[name]
    assert old in valid
    text = valid.replace(old, new, 1)
    assert findings(validator, text)
    with pytest.raises(ConfigError):
        load(write(text), shelf, environment={})


def test_a_file_that_includes_may_be_partial(validator):
    assert (
        findings(validator, "include: a.yaml\nnodes: {map: {resolution: [1]}, log: {plugin: carmen}, prior: ~}") == []
    )
    assert findings(validator, "nodes: {map: {plugin: grid}}")
    assert findings(validator, "pipeline: a\nnodes: {map: ~}")
    assert findings(validator, "include: a.yaml\nnodes: {map: {plugin: grid, resolution: []}}")


def test_schema_carries_units_defaults_and_meaning(shelf):
    schema = json.loads(json.dumps(json_schema(shelf)))  # plain JSON
    grid = schema["$defs"]["node.grid"]["properties"]
    assert grid["range_max"]["unit"] == "m"
    assert grid["range_max"]["default"] == 40.0
    assert grid["range_max"]["description"] == "[m] returns beyond count as none"
    assert grid["resolution"]["default"] == [0.3, 0.125, 0.05]
    assert set(grid["options"]["properties"]) == {"grid", "spline-surface"}
    scan = schema["$defs"]["node.gauss-newton"]["properties"]["inputs"]["anyOf"][0]["properties"]["scan"]
    assert scan["description"] == "to align"
    assert "node.doctor" not in schema["$defs"]


def test_every_reference_of_the_schema_has_a_definition(shelf):
    schema = json_schema(shelf)
    used = set()

    def collect(inner):
        if isinstance(inner, dict):
            if isinstance(inner.get("$ref"), str):
                used.add(inner["$ref"])
            for child in inner.values():
                collect(child)
        elif isinstance(inner, list):
            for child in inner:
                collect(child)

    collect(schema)
    assert used >= {"#/$defs/reference", "#/$defs/rig.Mount"}
    assert used <= {f"#/$defs/{name}" for name in schema["$defs"]}
