"""Includes, references and `--set`: who wins, what is typed, what is refused."""

import pytest

from knotwork.core.config import load
from knotwork.core.errors import ConfigError


def failing(path, shelf, overrides=(), environment=None):
    with pytest.raises(ConfigError) as caught:
        load(path, shelf, overrides, environment or {})
    return str(caught.value)


def rig(write, text, shelf, environment=None, head=""):
    return (
        load(
            write(f"pipeline: a\n{head}\nnodes: {{r: {{plugin: rig, {text}}}}}\n"),
            shelf,
            (),
            environment or {},
        )
        .nodes["r"]
        .config
    )


# includes


def test_later_files_win_and_mappings_merge(shelf, write):
    write(
        "pipeline: one\nseed: 1\nnodes: {m: {plugin: grid, resolution: [1.0, 0.5], range_max: 9}}\n",
        "one.yaml",
    )
    write("pipeline: two\nnodes: {m: {range_max: 8, fuse: false}}\n", "sub/two.yaml")
    path = write("include: [one.yaml, sub/two.yaml]\nnodes: {m: {resolution: [2.0]}, p: {plugin: ekf}}\n")
    pipeline = load(path, shelf)
    assert (pipeline.name, pipeline.seed) == ("two", 1)
    config = pipeline.nodes["m"].config
    assert (config.resolution, config.range_max, config.fuse) == ((2.0,), 8.0, False)
    assert list(pipeline.nodes) == ["m", "p"]
    assert pipeline.where("nodes.m.range_max") == "sub/two.yaml:2:24"


def test_include_is_relative_to_the_file_that_includes(shelf, write):
    write("pipeline: deep\nnodes: {p: {plugin: ekf}}\n", "a/b/deep.yaml")
    write("include: b/deep.yaml\n", "a/mid.yaml")
    assert load(write("include: a/mid.yaml\n"), shelf).where("pipeline") == "a/b/deep.yaml:1:11"


def test_include_cycle_shows_the_chain(shelf, write):
    write("include: b.yaml\n", "a.yaml")
    write("include: c.yaml\n", "b.yaml")
    write("include: b.yaml\n", "c.yaml")
    assert failing("a.yaml", shelf) == "c.yaml:1:10: include: files include each other: b.yaml -> c.yaml -> b.yaml"


def test_one_file_may_be_included_twice_but_not_for_ever(shelf, write):
    write("pipeline: x\nnodes: {p: {plugin: ekf}}\n", "f0.yaml")
    for number in range(1, 12):
        write(f"include: [f{number - 1}.yaml, f{number - 1}.yaml]\n", f"f{number}.yaml")
    assert load("f2.yaml", shelf).name == "x"
    assert "more than 64 files" in failing("f11.yaml", shelf)


def test_null_removes_a_node_and_an_entry(shelf, valid, write):
    write(valid, "base.yaml")
    path = write("include: base.yaml\nnodes:\n  recorder: ~\n  localizer: {inputs: {scan: ~}}\n", "top.yaml")
    pipeline = load(path, shelf, environment={})
    assert "recorder" not in pipeline.nodes
    assert pipeline.nodes["localizer"].inputs == {}
    write("include: base.yaml\nnodes:\n  recoder: ~\n", "typo.yaml")
    text = failing("typo.yaml", shelf)
    assert "typo.yaml:3:3: nodes.recoder: null removes a node" in text
    assert "did you mean 'recorder'?" in text


def test_error_in_an_included_file_shows_that_file(shelf, write):
    write("pipeline: x\nnodes: {p: {plugin: ekf, noise: -1}}\n", "base.yaml")
    assert failing(write("include: base.yaml\n"), shelf).startswith("base.yaml:2:33: nodes.p.noise: expected")


def test_too_large_together(shelf, write):
    numbers = ", ".join(["1"] * 60_000)
    for number in range(4):
        write(f"vars: {{v{number}: [{numbers}]}}\n", f"v{number}.yaml")
    path = write("include: [v0.yaml, v1.yaml, v2.yaml, v3.yaml]\npipeline: a\n")
    assert "larger than 200000 values with what it includes" in failing(path, shelf)


# references


@pytest.mark.parametrize(
    ("text", "environment", "token"),
    [
        ("token: '${T}'", {"T": "abc"}, "abc"),
        ("token: '${T}'", {"T": "12345"}, "12345"),
        ("token: '${T}'", {"T": "0123"}, "0123"),
        ("token: '${T}'", {"T": ""}, ""),
        ("token: '${T:-x}'", {"T": ""}, "x"),
        ("token: '${T:-12}'", {}, "12"),
        ("token: '${T:-}'", {}, ""),
        ("token: 'a${T:-1.50}b'", {}, "a1.50b"),
        ("token: '${T:-${U:-u}/x}'", {}, "u/x"),
        ("token: '${T:-${U:-u}/x}'", {"U": "v"}, "v/x"),
        ("token: '$${T} $x $'", {}, "${T} $x $"),
        ("token: '$$${T}'", {}, "$${T}"),
        ("token: 'a${word}${word}'", {"word": "no"}, "ahihi"),
        ("token: '${env:word}'", {"word": "yes"}, "yes"),
        ("token: 'v${whole}'", {}, "v7"),
        ("token: 'v${real} ${flag}'", {}, "v0.5 true"),
    ],
)
def test_references_in_texts(text, environment, token, shelf, write):
    head = "vars: {word: hi, whole: 7, real: 0.50, flag: true}"
    assert rig(write, text, shelf, environment, head).token == token


def test_whole_references_keep_their_type(shelf, write):
    head = "vars: {n: 3, beams: [{x: '${n}'}, '${one}'], one: {yaw: '${YAW:-0.5}'}, gone: '${NOT_SET:-~}'}"
    config = rig(write, "port: '${n}', beams: '${beams}', limit: '${LIMIT}'", shelf, {"LIMIT": "1e-3"}, head)
    assert config.port == 3
    assert [(beam.x, beam.yaw) for beam in config.beams] == [(3.0, 0.0), (0.0, 0.5)]
    assert config.limit == 0.001
    assert rig(write, "limit: '${gone}'", shelf, {}, "vars: {gone: '${NOT_SET:-~}'}").limit is None


def test_environment_does_not_leak_into_other_types(shelf, write):
    path = write("pipeline: a\nnodes: {r: {plugin: rig, limit: '${L}'}}\n")
    assert "p.yaml:2:33: nodes.r.limit: expected a number [m/s], got 'fast'" in failing(path, shelf, (), {"L": "fast"})


def test_variable_default_when_null(shelf, write):
    assert rig(write, "token: '${t:-x}'", shelf, {}, "vars: {t: ~}").token == "x"


def test_unused_variables_are_checked_once(shelf, write):
    path = write("pipeline: a\nvars: {a: '${nope}', b: '${a}'}\nnodes: {r: {plugin: rig, token: '${b}'}}\n")
    text = failing(path, shelf)
    assert text.startswith("p.yaml:2:11: vars.a: there is no variable 'nope'")
    assert "\n" not in text


def test_environment_that_is_no_text(shelf, write):
    path = write("pipeline: a\nnodes: {r: {plugin: rig, token: 'x${T}'}}\n")
    assert "env T is not valid UTF-8" in failing(path, shelf, (), {"T": "\udcff"})


@pytest.mark.parametrize(
    ("head", "expected"),
    [
        (
            "vars:\n  v0: [1, 1]\n" + "".join(f"  v{n}: ['${{v{n - 1}}}', '${{v{n - 1}}}']\n" for n in range(1, 30)),
            "large",
        ),
        (
            "vars:\n  v0: abcdefgh\n" + "".join(f"  v{n}: '{f'${{v{n - 1}}}' * 8}'\n" for n in range(1, 30)),
            "large",
        ),
        (
            "vars:\n  v0: 1\n" + "".join(f"  v{n}: '${{v{n - 1}}}'\n" for n in range(1, 3000))[:90_000] + "",
            "deep",
        ),
        ("vars: {a: '" + "${A:-" * 50_000 + "}" * 50_000 + "'}", "nested deeper than 8"),
        ("vars: {a: '" + "${A:-" * 50_000 + "'}", "nested deeper than 8"),
    ],
    ids=["lists", "texts", "chain", "defaults", "unclosed"],
)
def test_references_cannot_blow_up(head, expected, shelf, write):
    # The chain is asked from its end, so that every variable waits for the one before.
    lines = head.split("\n")
    reordered = "\n".join([lines[0], *reversed([line for line in lines[1:] if line])])
    path = write(f"pipeline: a\n{reordered}\nnodes: {{p: {{plugin: ekf}}}}\n")
    assert expected in failing(path, shelf)


# --set


def test_overrides(shelf, valid, write):
    overrides = [
        "nodes.map.plugin=grid",
        "nodes.map.resolution.0=1e0",
        "nodes.map.options.grid={kernel: bilinear}",
        "nodes.prior.noise=2",
        "nodes.prior.noise=3",
        "nodes.recorder=~",
        "nodes.view.plugin=mcap",
        "nodes.view.queue.size=5",
        "nodes.extra={plugin: ekf}",
        "vars.log=/x/a=b.clf",
        "rate=2.5",
        "pipeline=other",
    ]
    pipeline = load(write(valid), shelf, overrides, {})
    nodes = pipeline.nodes
    assert nodes["map"].plugin == "grid"
    assert nodes["map"].config.resolution == (1.0, 0.125, 0.05)
    assert nodes["map"].options.kernel == "bilinear"
    assert nodes["prior"].config.noise == 3.0
    assert "recorder" not in nodes
    assert nodes["view"].queue.size == 5
    assert nodes["extra"].plugin == "ekf"
    assert nodes["log"].config.path == "/x/a=b.clf"
    assert (pipeline.rate, pipeline.name) == (2.5, "other")


def test_override_of_a_section_merges(shelf, valid, write):
    pipeline = load(write(valid), shelf, ["nodes={prior: {noise: 4}, recorder: ~}", "vars={far: 12}"], {})
    assert pipeline.nodes["prior"].config.noise == 4.0
    assert pipeline.nodes["map"].config.range_max == 12.0
    assert "recorder" not in pipeline.nodes


def test_override_refers_to_variables_and_environment(shelf, valid, write):
    pipeline = load(write(valid), shelf, ["nodes.map.range_max=${R}", "nodes.log.path=${far}.clf"], {"R": "7"})
    assert pipeline.nodes["map"].config.range_max == 7.0
    assert pipeline.nodes["log"].config.path == "30.0.clf"
    assert str(pipeline.origins["nodes.map.range_max"]) == "--set nodes.map.range_max=${R} via env R"


@pytest.mark.parametrize(
    ("argument", "expected"),
    [
        ("nodes.mpa.plugin.x=1", ["unknown node 'mpa'", "did you mean 'map'?"]),
        ("nodes.mpa.range_max=1", ["unknown node 'mpa'"]),
        ("nodes.mpa=~", ["unknown node 'mpa'"]),
        ("nodes.map.range_mx=1", ["nodes.map.range_mx: unknown key", "did you mean 'range_max'?"]),
        ("nodes.map.range_max=-1", ["expected a number > 0 [m], got -1"]),
        ("nodes.map.fuse=off", ["expected true or false, got 'off' (write false)"]),
        ("nodes.map.resolution.3=1", ["expected an index 0 to 2, got '3'"]),
        ("nodes.map.resolution.-1=1", ["expected an index 0 to 2"]),
        ("nodes.map.resolution.x=1", ["expected an index 0 to 2"]),
        ("nodes.map.plugin.x=1", ["nodes.map.plugin is 'spline-surface', which has no 'x'"]),
        ("nodes.prior.list.0=1", ["not written as a list in the file"]),
        ("nodes.map.plugin=gird", ["there is no plugin 'gird' (did you mean 'grid'?)"]),
        ("vars.lgo=x", ["unknown variable 'lgo'", "did you mean 'log'?"]),
        ("sead=1", ["unknown key 'sead'", "did you mean 'seed'?"]),
        ("include=x.yaml", ["include cannot be set"]),
        ("nodes.map.range_max", ["expected KEY=VALUE"]),
        ("=1", ["expected KEY=VALUE"]),
        ("nodes..x=1", ["expected KEY=VALUE"]),
        ("nodes.map.range_max=", ["the value is empty"]),
        ("nodes.map.range_max=[1", ["not valid YAML"]),
        ("nodes.map.range_max={a: 1, a: 2}", ["'a' is repeated"]),
        ("nodes.map.range_max=!!python/object:x 1", ["tag"]),
        ("nodes.map.range_max=010", ["starts with 0"]),
        ("nodes.map.save=\udcff", ["U+DCFF"]),
        ("nodes.map.range_max=${oops}", ["there is no variable 'oops'"]),
        ("." * 100 + "=1", ["expected KEY=VALUE"]),
        ("nodes.map." + "x." * 100 + "x=1", ["expected KEY=VALUE"]),
    ],
)
def test_wrong_override_points_at_the_argument(argument, expected, shelf, valid, write):
    text = failing(write(valid), shelf, [argument])
    assert text.startswith("--set " + argument.replace("\udcff", r"\udcff")[:60])
    assert "\n" not in text
    for fragment in expected:
        assert fragment in text
