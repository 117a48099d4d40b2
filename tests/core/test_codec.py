"""Every message type survives the codec bit for bit; the strategies are built from the annotations."""

import struct
from contextlib import suppress
from dataclasses import MISSING, dataclass, fields
from types import NoneType, UnionType
from typing import Any, ClassVar, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from knotwork.core import codec
from knotwork.core import message_types as table_module
from knotwork.core import messages as messages_module
from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.message_types import is_wall_clock, message_class, message_types, register
from knotwork.core.messages import F64, Message, Scan, Statistics, Twist

TYPES = sorted(message_types())
INTEGERS = st.integers(-(2**63), 2**63 - 1)
FLOATS = st.floats(allow_nan=True, allow_infinity=True, allow_subnormal=True)
PLAIN = st.recursive(
    st.none() | st.booleans() | INTEGERS | FLOATS | st.text(max_size=5) | st.binary(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


def arrays(dtype: Any) -> st.SearchStrategy[Any]:
    shapes = hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=5)
    return hnp.arrays(dtype, shapes).flatmap(lambda a: st.sampled_from([a, a.T, a[..., ::-1] if a.ndim else a]))


def strategy(annotation: Any) -> st.SearchStrategy[Any]:
    origin, parameters = get_origin(annotation), get_args(annotation)
    if origin in (UnionType, Union):
        return st.one_of([strategy(part) for part in parameters])
    if origin is Literal:
        return st.sampled_from(parameters)
    if origin is tuple:
        return st.tuples(*(strategy(part) for part in parameters))
    if origin is dict:
        return st.dictionaries(strategy(parameters[0]), strategy(parameters[1]), max_size=4)
    if origin is np.ndarray:
        return arrays(get_args(parameters[1])[0])
    if origin is NDArray:  # NumPy 2.5 and newer: an alias that keeps its name
        return arrays(parameters[0])
    return {
        int: INTEGERS,
        float: FLOATS,
        bool: st.booleans(),
        str: st.text(max_size=8),
        bytes: st.binary(max_size=40),
        NoneType: st.none(),
        Any: PLAIN,
    }[annotation]


def messages(cls: type[Message]) -> st.SearchStrategy[Message]:
    hints = get_type_hints(cls)
    return st.builds(cls, **{field.name: strategy(hints[field.name]) for field in fields(cls)})


def bits(value: Any) -> Any:
    """Turn a value into something that is equal only for the same type, shape and bits."""
    if isinstance(value, np.ndarray):
        return ("array", value.dtype.str, value.shape, value.tobytes())
    if isinstance(value, float):
        return ("float", struct.pack("<d", value))
    if isinstance(value, list | tuple):
        return (type(value).__name__, [bits(item) for item in value])
    if isinstance(value, dict):
        return ("dict", [(key, bits(item)) for key, item in value.items()])
    return (type(value).__name__, value)


def content(message: Message) -> Any:
    return type(message), [(field.name, bits(getattr(message, field.name))) for field in fields(message)]


@pytest.mark.parametrize("name", TYPES)
@given(data=st.data())
def test_round_trip_bit_for_bit(name, data):
    cls = message_class(name)
    message = data.draw(messages(cls))
    again = codec.decode(cls, codec.encode(message))
    assert content(again) == content(message)
    for field in fields(again):
        value = getattr(again, field.name)
        if isinstance(value, np.ndarray):
            assert not value.flags.writeable
            assert value.flags.aligned
            assert value.flags.c_contiguous


@pytest.mark.parametrize("dtype", ["<f8", "<f4", "<f2", "<c16", "i1", "<u8", "?", "<U3", "S4", "<M8[ns]"])
@pytest.mark.parametrize("shape", [(), (0,), (3,), (2, 3), (0, 4), (2, 1, 3)])
def test_any_dtype_and_shape(dtype, shape):
    array = np.zeros(shape, dtype)
    again = codec.decode(Statistics, codec.encode(Statistics(stamp=0, data={"a": array}))).data["a"]
    assert (again.dtype, again.shape) == (array.dtype, array.shape)
    assert again.tobytes() == array.tobytes()


def test_array_layout_is_what_the_docstring_says():
    raw = codec.encode(Statistics(stamp=0, data={"a": np.array([[1.0, -2.0]], ">f4")}))
    extension = msgspec.msgpack.decode(raw)["data"]["a"]
    assert extension.code == 1
    assert bytes(extension.data) == b"\x03<f4\x02" + struct.pack("<II2f", 1, 2, 1.0, -2.0)


def test_numpy_scalars_become_plain_numbers():
    message = Twist(stamp=np.int64(5), vx=np.float32(0.1), vy=np.float64("nan"))  # type: ignore[arg-type]
    again = codec.decode(Twist, codec.encode(message))
    assert type(again.stamp) is int
    assert type(again.vx) is float
    assert again.vx == float(np.float32(0.1))


def test_newer_and_older_fields():
    message = Twist(stamp=1, vx=0.5)
    plain = msgspec.msgpack.decode(codec.encode(message))
    newer = msgspec.msgpack.encode({**plain, "a_field_of_next_year": [1, 2]})
    assert content(codec.decode(Twist, newer)) == content(message)
    older = msgspec.msgpack.encode({"stamp": 1, "vx": 0.5})
    assert content(codec.decode(Twist, older)) == content(message)
    with pytest.raises(InputError, match=r"twist.*required field `vx`"):
        codec.decode(Twist, msgspec.msgpack.encode({"stamp": 1}))


@pytest.mark.parametrize("name", TYPES)
def test_required_fields_are_required(name):
    cls = message_class(name)
    required = [f.name for f in fields(cls) if f.default is MISSING and f.default_factory is MISSING]
    with pytest.raises(InputError, match=f"`{required[0]}`"):
        codec.decode(cls, b"\x80")


@given(st.binary(max_size=60))
def test_noise_is_an_input_error(data):
    with pytest.raises(InputError):
        codec.decode(Scan, data)


@given(st.data())
def test_a_changed_byte_is_an_input_error_or_a_message(data):
    scan = Scan(
        stamp=1,
        scan_id=0,
        ranges=np.ones(3, np.float32),
        angle_min=0.0,
        angle_increment=0.1,
        range_min=0.0,
        range_max=9.0,
    )
    raw = bytearray(codec.encode(scan))
    raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    with suppress(InputError):
        assert isinstance(codec.decode(Scan, bytes(raw)), Scan)


@dataclass(frozen=True, slots=True)
class Part:
    weight: float
    points: F64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Third(Message):
    """A third party's type, without any code for logging."""

    type_name: ClassVar[str] = "third"
    parts: list[Part]
    grid: F64 | None = None
    pair: tuple[int, str] = (0, "")
    names: dict[int, list[str]]


def test_third_party_type():
    message = Third(stamp=3, parts=[Part(0.1, np.eye(2))], pair=(4, "x"), names={2: ["a"]})
    again = codec.decode(Third, codec.encode(message))
    assert again.parts[0].points.tolist() == [[1, 0], [0, 1]]
    assert (again.pair, again.names, again.grid, again.stamp) == ((4, "x"), {2: ["a"]}, None, 3)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nested(Message):
    type_name: ClassVar[str] = "nested"
    parts: list[complex]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unnamed(Message):
    value: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ambiguous(Message):
    type_name: ClassVar[str] = "ambiguous"
    value: list[int] | tuple[int, int]


@pytest.mark.parametrize(
    ("cls", "says"),
    [(Nested, "Nested.parts has type complex"), (Unnamed, "type_name"), (Ambiguous, "cannot be logged")],
)
def test_unsupported_types_are_refused(cls, says):
    with pytest.raises(KnotworkError, match=says):
        codec.check(cls)


def test_unsupported_values_are_refused():
    for value in (object(), np.array([None]), np.zeros(1, [("a", "f4")]), 1 << 70):
        with pytest.raises(KnotworkError, match="`statistics` message cannot be logged"):
            codec.encode(Statistics(stamp=0, data={"a": value}))


def test_canonical_form_ignores_the_order_of_keys():
    one, two = (Statistics(stamp=0, data=d) for d in ({"a": 1, "b": 2}, {"b": 2, "a": 1}))
    assert codec.encode(one) != codec.encode(two)
    assert codec.encode_canonical(one) == codec.encode_canonical(two)


def test_json_schema_names_the_fields():
    schema = msgspec.json.decode(codec.json_schema(Scan))
    assert schema["$defs"]["Scan"]["properties"].keys() == {field.name for field in fields(Scan)}


def test_registering(monkeypatch):
    monkeypatch.setattr(table_module, "_TYPES", dict(message_types()))
    monkeypatch.setattr(table_module, "_WALL_CLOCK", {"statistics"})
    register("third", f"{__name__}:Third", wall_clock=True)
    register("third", f"{__name__}:Third")  # again the same: fine
    assert is_wall_clock("third")
    assert is_wall_clock("statistics")
    assert not is_wall_clock("scan")
    with pytest.raises(KnotworkError, match=r"`third` is .*:Third already"):
        register("third", "elsewhere:Third")
    with pytest.raises(KnotworkError, match="not of the form"):
        register("fourth", "no_colon")
    with pytest.raises(InputError, match=r"unknown message type `nonsense`; known are .*scan"):
        message_class("nonsense")
    register("broken", "knotwork.no_such_module:X")
    with pytest.raises(InputError, match="`broken` cannot be loaded"):
        message_class("broken")
    register("misnamed", "knotwork.core.messages:Scan")
    with pytest.raises(InputError, match="calls itself `scan`"):
        message_class("misnamed")


def test_table_holds_every_message_class():
    found = {c.type_name: c for c in vars(messages_module).values() if isinstance(c, type) and issubclass(c, Message)}
    del found[""]  # Message itself
    assert {name: message_class(name) for name in found} == found
    assert found.keys() == set(TYPES)
