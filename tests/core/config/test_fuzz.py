"""Whatever stands in a file or an argument: a pipeline or a ConfigError, nothing else, and no hang."""

import random

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from knotwork.core.config import Pipeline, dump, load, show
from knotwork.core.errors import ConfigError

pytestmark = pytest.mark.timeout(120)

ENVIRONMENT = {"A": "1", "B": "", "TOKEN": "x", "BAD": "\udcff", "LONG": "x" * 10_000}


@pytest.fixture(scope="module")
def survives(shelf, tmp_path_factory):
    path = tmp_path_factory.mktemp("fuzz") / "p.yaml"

    def run(data, overrides=()):
        path.write_bytes(data if isinstance(data, bytes) else data.encode("utf-8", "surrogatepass"))
        try:
            pipeline = load(path, shelf, overrides, ENVIRONMENT)
        except ConfigError as error:
            lines = [str(problem) for problem in error.problems]
            if not lines or any("\n" in line for line in lines):
                raise
            return None
        assert isinstance(pipeline, Pipeline)
        path.write_text(dump(pipeline.resolved), "utf-8")
        assert load(path, shelf, (), {}) == pipeline
        assert show(pipeline, origin=True)
        return pipeline

    return run


# fmt: off
SYNTAX = st.sampled_from([
    "\n", "\n  ", "  ", "\t", ": ", "- ", "? ", "[", "]", "{", "}", ", ", "&a ", "*a", "!!str ", "!x ", "<<",
    "<<: *a", "|", ">-", "'", '"', "#", "%", "---\n", "...\n", "~", "1e-3", "010", "on", "true", ".nan", "=",
    "${A}", "${", "$${", "${x:-", "}", "nodes:", "  m:\n    ", "plugin: grid", "plugin: rig", "pipeline: p\n",
    "vars: ", "x: ", "include: ", "p.yaml", "options: ", "grid: ", "\\u0041", '"\\ud800"', '"\\x07"', "@",
    "`", "\x00", "\x85", "\ufeff", "\u2028",
])
WORDS = [
    "pipeline", "nodes", "vars", "include", "plugin", "uses", "inputs", "options", "queue", "worker", "size",
    "policy", "grid", "rig", "carmen", "mcap", "m", "map", "scan", "mounts", "beams", "x", "token", "port",
    "rate",
]
STEPS = [*WORDS, "0", "-1", "log", "recorder", "resolution", "spline-surface", ""]
# fmt: on
VALUES = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.sampled_from([*WORDS, "${A}", "${x}", "${env:B}", "m.grid", "configs:x", "p.yaml", ".", "/", ""])
    | st.text(max_size=5)
)
KEYS = st.sampled_from(WORDS) | st.text(max_size=3)
STRUCTURES = st.recursive(
    VALUES,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS, inner, max_size=5),
    max_leaves=30,
)
SECTIONS = st.dictionaries(st.sampled_from(WORDS), STRUCTURES, max_size=6)


@given(st.binary(max_size=200))
@example(b"\xef\xbb\xbf")
@example(b"\xff\xfe\x00")
def test_bytes(survives, data):
    survives(data)


@given(st.text(max_size=200))
def test_text(survives, data):
    survives(data)


@given(st.lists(SYNTAX, max_size=40).map("".join))
@example("a: &a [*a]")
@example("&a *a")
@example("? ? ? a")
@example("%YAML 9.9\n--- a: b")
@example("!<!> a")
@example("{? [a]: b, <<: {c: d}, <<: x}")
def test_pieces_of_syntax(survives, data):
    survives(data)


@given(STRUCTURES)
@example({"\n": None})
@example({"\x1b[31m": 1})
def test_any_structure(survives, data):
    survives(_write({"pipeline": "p", "nodes": data}))


@given(
    st.dictionaries(st.sampled_from(WORDS), STRUCTURES, max_size=6),
    st.sampled_from(["rig", "grid", "carmen"]),
)
def test_any_structure_in_a_node(survives, data, plugin):
    survives(_write({"pipeline": "p", "nodes": {"m": {**data, "plugin": plugin}, "map": {"plugin": "mcap"}}}))


@given(SECTIONS)
def test_any_structure_at_the_top(survives, data):
    survives(_write(data))


@given(st.data())
def test_mutated_valid_file(survives, valid, data):
    text = valid
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        length = data.draw(st.integers(0, 12))
        text = text[:start] + data.draw(SYNTAX | st.text(max_size=3)) + text[start + length :]
    survives(text)


@given(st.data())
def test_lines_moved(survives, valid, data):
    lines = valid.split("\n")
    order = data.draw(st.lists(st.integers(0, len(lines) - 1), max_size=len(lines) + 3))
    survives("\n".join(lines[number] for number in order))


PATHS = st.lists(st.sampled_from(STEPS), max_size=6).map(".".join)
ANYTHING = SYNTAX | st.text(max_size=6) | STRUCTURES.map(repr)


@given(PATHS, st.sampled_from(["=", "=", "=", ""]), ANYTHING)
@example("nodes", "=", "~")
@example("nodes", "=", "5")
@example("vars", "=", "~")
@example("nodes.map", "=", "[]")
@example("nodes.map.resolution", "=", "${A}")
def test_any_override(survives, valid, key, equals, value):
    survives(valid, [key + equals + value])


@given(st.lists(st.text("ab:-}{$env ", max_size=20), min_size=1, max_size=3))
def test_any_reference(survives, texts):
    survives(_write({"pipeline": "p", "vars": {"a": "${" + texts[0], "b": texts[-1]}, "nodes": {"r": _rig(texts)}}))


def _rig(texts):
    return {"plugin": "rig", "token": "".join(texts), "folder": "${a}${b:-}"}


def _write(data):
    try:
        return dump(data)
    except (ValueError, AttributeError):
        return str(data)


@pytest.mark.parametrize(
    "text",
    [
        "[" * 400_000,
        "{" * 400_000,
        "- " * 400_000,
        "? " * 400_000,
        "&a " * 300_000,
        "!!a " * 200_000,
        "a: " * 300_000,
        "'" + "x" * 1_000_000,
        '"\\' * 400_000,
        "x: |\n" + "  a\n" * 200_000,
        "\n".join(f"k{n}: {n}" for n in range(80_000)),
        "\n".join(f"a{n}: &a{n} x" for n in range(20_000)),
        "pipeline: p\nvars: {a: '" + "${" * 400_000 + "'}",
        "pipeline: p\nvars: {a: '" + "$${" * 300_000 + "'}",
        "pipeline: p\nnodes: {" + ", ".join(f"n{n}: {{plugin: rig, x: 1}}" for n in range(5_000)) + "}",
        "pipeline: p\nnodes: {r: {plugin: rig, beams: [" + ", ".join(["{x: a}"] * 20_000) + "]}}",
        "pipeline: p\nnodes: {r: {plugin: rig, mounts: {"
        + ", ".join(f"{'k' * 9}{n}: 1" for n in range(30_000))
        + "}}}",
    ],
    ids=range(17),
)
def test_hostile_sizes_end(survives, text):
    # A reader that is quadratic in any of these needs hours; the module's time limit ends it.
    assert survives(text) is None


def test_random_bytes_in_bulk(survives):
    source = random.Random(0)
    for size in (1000, 10_000, 100_000):
        survives(source.randbytes(size))
        survives("".join(chr(source.randrange(32, 127)) for _ in range(size)))
