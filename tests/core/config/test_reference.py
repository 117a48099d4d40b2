"""The written reference says what the models say."""

from typing import Annotated, Any, Literal

import jsonschema
import pytest
from pydantic import ConfigDict, Field

from knotwork.core.config import json_schema, load, reference
from knotwork.core.errors import ConfigError
from knotwork.core.manifest import KINDS, Manifest, PluginConfig, quantity


def test_every_key_of_every_plugin_is_in_the_reference(shelf):
    text = reference(shelf)
    for manifest in shelf.manifests.values():
        if manifest.kind == "command":
            assert f"### {manifest.name}\n" not in text
            continue
        section = text.split(f"### {manifest.name}\n")[1].split("\n### ")[0].split("\n## ")[0]
        assert manifest.summary in section
        models = [model for model in (manifest.config, manifest.options) if model]
        for name in (name for model in models for name in model.model_fields):
            assert f"| `{name}` |" in section
        for name in (*manifest.inputs, *manifest.outputs, *manifest.uses):
            assert f" | {name} | " in section


def test_rows(shelf):
    text = reference(shelf)
    for row in [
        "| `range_max` | number > 0 | m | `40.0` | returns beyond count as none |",
        "| `resolution` | list of (number > 0) | m | `[0.3, 0.125, 0.05]` | cell sides, coarse to fine |",
        "| `path` | text |  | required | the log file |",
        "| `degree` | whole number >= 1 and <= 5 | 1 | `3` | of the spline |",
        '| `loss` | `"none"` or `"huber"` or `"cauchy"` |  | `"none"` | robust loss |',
        "| `mounts.NAME.yaw` | number | rad | `0.0` | left |",
        "| `beams[].x` | number | m | `0.0` | forward |",
        "| `limit` | number > 0 or null | m/s | `null` | none: no limit |",
        "| use | prior | prior | optional | where to begin |",
        "| output | pose | pose (estimate) |  |  |",
        '| `rate` | `"max"` or number > 0 | 1 | `"max"` | pace of a replay as a multiple of sensor time |',
        "| `queue.size` | whole number >= 1 and <= 1e+06 | messages | `100` | messages it holds |",
    ]:
        assert row + "\n" in text, row
    assert "Needs `pip install knotwork[mcap]`" in text
    assert "```yaml\nmap: {plugin: grid}\n```" in text


def test_reference_is_the_same_each_time(shelf):
    class Backwards:
        def __getattr__(self, name):
            return getattr(shelf, name)

        def names(self, kind=None):
            return shelf.names(kind)[::-1]

    assert reference(Backwards()) == reference(shelf)
    assert json_schema(Backwards()) == json_schema(shelf)


class Anything:
    pass


class OddKeys(PluginConfig):
    """What other people's models may hold."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    free: Any = Field(None, description="a | b\nc")
    thing: Anything | None = Field(None, description="not for a file")
    pair: tuple[int, int] = quantity((1, 2), "px", "of the image")
    renamed: int = Field(1, alias="re-named", description="by alias")


def test_odd_models_do_not_break_it(write):
    odd = Manifest("odd", "sink", "odd", "x:X", OddKeys)

    class One:
        def find(self, name):
            return odd if name == "odd" else None

        def names(self, kind=None):
            return ["odd"]

        def why_not(self, name):
            return ""

    assert "### odd" in reference(One())
    assert json_schema(One())["$defs"]["node.odd"]["properties"]["free"] is not None
    config = load(write("pipeline: a\nnodes: {o: {plugin: odd, re-named: 5, pair: [3, 4]}}\n"), One()).nodes["o"].config
    assert (config.renamed, config.pair) == (5, (3, 4))


class Segment(PluginConfig):
    shape: Literal["segment"]
    length: float = quantity(..., "m", "from end to end", gt=0)


class Arc(PluginConfig):
    shape: Literal["arc"]
    radius: float = quantity(..., "m", "of the circle", gt=0)


class WorldKeys(PluginConfig):
    walls: list[Annotated[Segment | Arc, Field(discriminator="shape")]] = Field([], description="the world")


def test_unions_with_a_tag(write):
    world = Manifest("world", "driver", "a world", "x:X", WorldKeys)

    class One:
        def find(self, name):
            return world if name == "world" else None

        def names(self, kind=None):
            return ["world"]

        def why_not(self, name):
            return ""

    def text(walls):
        return write(f"pipeline: a\nnodes: {{w: {{plugin: world, walls: {walls}}}}}\n")

    def problem(walls):
        with pytest.raises(ConfigError) as caught:
            load(text(walls), One())
        return str(caught.value)

    assert load(text("[{shape: arc, radius: 1}]"), One()).nodes["w"].config.walls[0].radius == 1.0
    arc = problem("[{shape: arc, radius: 0}]")
    assert arc == "p.yaml:2:57: nodes.w.walls.0.radius: expected a number > 0 [m], got 0"
    assert "radiu: unknown key of plugin 'world' (did you mean 'radius'?)" in problem("[{shape: arc, radiu: 1}]")
    assert "walls.0.length: missing, expected from end to end [m]" in problem("[{shape: segment}]")
    assert "'segment', 'arc'" in problem("[{shape: line}]")
    assert "| `walls[].radius` | number > 0 | m | required | of the circle |" in reference(One())
    check = jsonschema.Draft202012Validator(json_schema(One()))
    assert check.is_valid(
        {"pipeline": "a", "nodes": {"w": {"plugin": "world", "walls": [{"shape": "arc", "radius": 1}]}}}
    )
    assert not check.is_valid({"pipeline": "a", "nodes": {"w": {"plugin": "world", "walls": [{"shape": "arc"}]}}})


def test_all_kinds_have_a_place(write):
    def names(kind):
        return Manifest(f"a-{kind}", kind, "x", "x:X")

    class All:
        def find(self, name):
            return names(name.removeprefix("a-"))

        def names(self, kind=None):
            return [f"a-{one}" for one in KINDS]

        def why_not(self, name):
            return ""

    assert all(f"### a-{kind}" in reference(All()) for kind in KINDS if kind != "command")
