"""The strict reader against PyYAML where both should agree, and against the traps where they must not."""

import math
import re
import string

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core.config import dump
from knotwork.core.config.tree import MAX_SIZE, Problems, plain
from knotwork.core.config.yaml_source import compose
from knotwork.core.errors import ConfigError


def read(text):
    problems = Problems()
    item = compose(text, lambda line, column: f"{line + 1}:{column + 1}", problems)
    problems.check()
    return plain(item) if item else None


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001),
        ("1E5", 1e5),
        ("-.5", -0.5),
        ("5.", 5.0),
        ("+7", 7),
        ("0x1F", 31),
        ("0o17", 15),
        ("0", 0),
        ("-0", 0),
        ("00.5", 0.5),
        (".inf", math.inf),
        ("-.inf", -math.inf),
        ("on", "on"),
        ("Off", "Off"),
        ("yes", "yes"),
        ("n", "n"),
        ("True", "True"),
        ("FALSE", "FALSE"),
        ("true", True),
        ("false", False),
        ("12:30:45", "12:30:45"),
        ("2024-01-02", "2024-01-02"),
        ("1_000", "1_000"),
        ("0b11", "0b11"),
        ("1.2.3", "1.2.3"),
        ("=", "="),
        ("~", None),
        ("null", None),
        ("''", ""),
        ('"5"', "5"),
        ("'true'", "true"),
        ("18446744073709551615", 2**64 - 1),
    ],
)
def test_scalars(text, value):
    found = read(f"x: {text}")["x"]
    assert found == value
    assert type(found) is type(value)


def test_nan():
    assert math.isnan(read("x: .nan")["x"])


@pytest.mark.parametrize("text", ["010", "-007", "08", "18446744073709551616", "1e400", "9" * 5000, "0x" + "f" * 40])
def test_numbers_nobody_can_agree_on(text):
    with pytest.raises(ConfigError, match="1:4"):
        read(f"x: {text}")


def test_positions_of_keys_and_values():
    problems = Problems()
    item = compose("a:\n  - x\n  - {b: 'ß', c: 3}\n", lambda line, column: f"{line + 1}:{column + 1}", problems)
    places = {path: (child.key, child.where) for path, child in item.walk()}
    assert places == {
        (): ("", "1:1"),
        ("a",): ("1:1", "2:3"),
        ("a", 0): ("", "2:5"),
        ("a", 1): ("", "3:5"),
        ("a", 1, "b"): ("3:6", "3:9"),
        ("a", 1, "c"): ("3:14", "3:17"),
    }


def test_anchors_and_merge_keys():
    text = "a: &a {x: 1, y: 2}\nb: *a\nc: {<<: *a, y: 3}\nd: {<<: [{x: 7}, *a], z: 1}\ne: {'<<': 5}\n"
    assert read(text) == {
        "a": {"x": 1, "y": 2},
        "b": {"x": 1, "y": 2},
        "c": {"x": 1, "y": 3},
        "d": {"x": 7, "y": 2, "z": 1},
        "e": {"<<": 5},
    }
    with pytest.raises(ConfigError, match="<< takes a mapping"):
        read("c: {<<: 5}")


def test_aliases_cannot_blow_up():
    laughs = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 12)
    )
    with pytest.raises(ConfigError, match=f"larger than {MAX_SIZE} values"):
        read(laughs)
    tower = "a0: &a0 [x]\n" + "".join(f"a{n}: &a{n} [*a{n - 1}]\n" for n in range(1, 100))
    with pytest.raises(ConfigError, match="or 40 levels"):
        read(tower)
    long_text = f"a: &a {'x' * 100_000}\nb: [{', '.join(['*a'] * 1000)}]\n"
    with pytest.raises(ConfigError, match="larger than"):
        read(long_text)


def test_windows_line_ends_and_byte_order_mark(shelf, valid, write):
    from knotwork.core.config import load

    plainly = load(write(valid), shelf, environment={})
    assert load(write(b"\xef\xbb\xbf" + valid.replace("\n", "\r\n").encode()), shelf, environment={}) == plainly


TEXTS = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), max_size=30) | st.text(
    string.printable, max_size=20
)
SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63)
    | st.floats(allow_nan=False)
    | TEXTS
    | st.sampled_from(["on", "010", "1e5", "${x}", "a: b", "- a", "#", "~", "12:30", "'", '"', "a #b", " a", "<<"])
)
TREES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(TEXTS, inner, max_size=5),
    max_leaves=20,
)


def _numbers_of_yaml_1_2(data):
    """Say whether a text is in `data` that is a number for us and a text for PyYAML (`1e5`, `08`, `0o7`)."""
    if isinstance(data, dict | list):
        both = [*data.keys(), *data.values()] if isinstance(data, dict) else data
        return any(_numbers_of_yaml_1_2(child) for child in both)
    return isinstance(data, str) and re.fullmatch(r"[-+]?[0-9.]+([eE][-+]?[0-9]+)?|0[xo][0-9a-fA-F]+", data)


@given(TREES.filter(lambda data: not _numbers_of_yaml_1_2(data)))
def test_what_pyyaml_writes_is_read_back(data):
    # PyYAML escapes what YAML 1.1 would misread, so both readers must agree on its output.
    text = yaml.safe_dump({"x": data}, sort_keys=False)
    assert read(text) == {"x": data}


@given(st.dictionaries(TEXTS, TREES, min_size=1, max_size=5))
def test_what_we_write_is_read_back_by_us_and_by_pyyaml(data):
    text = dump(data)
    assert read(text) == data
    assert yaml.safe_load(text) == data
