"""Lossless binary form of every message: MessagePack of its fields, arrays as an extension.

A map of field names, so that a newer reader fills what an older log lacks and an older reader skips
what it does not know. An array is extension 1: length of the dtype's name (uint8), the name ("<f4"),
number of axes (uint8), the axes (uint32 each), the elements in C order, little-endian. Floats keep
their bits (NaN, inf, -0.0). Inside a field typed `Any` a tuple becomes a list; anything typed stays.
"""

import struct
from typing import Any, TypeVar, get_origin

import msgspec
import numpy as np
from numpy.typing import NDArray

from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.messages import Message

M = TypeVar("M", bound=Message)

ARRAY_EXTENSION = 1
_HEADS_KEPT = 1024

_heads: dict[tuple[np.dtype[Any], tuple[int, ...]], bytes] = {}
_decoders: dict[type[Message], msgspec.msgpack.Decoder[Any]] = {}


def encode(message: Message) -> bytes:
    """Return the binary form of a message.

    Raises
    ------
    KnotworkError
        A field holds something that has no binary form.
    """
    try:
        return _encoder.encode(message)
    except (TypeError, OverflowError, ValueError) as error:
        raise _unfit(message, error) from error


def encode_canonical(message: Message) -> bytes:
    """Return a binary form that does not depend on the order of dicts and sets; for comparing."""
    try:
        return _canonical.encode(message)
    except (TypeError, OverflowError, ValueError) as error:
        raise _unfit(message, error) from error


def decode(cls: type[M], data: bytes | memoryview) -> M:
    """Return the message of type `cls` whose binary form is `data`; its arrays are read-only.

    Fields the class does not know are ignored, absent ones get their defaults.

    Raises
    ------
    InputError
        `data` is damaged, or lacks a field that has no default.
    KnotworkError
        The class cannot be logged (see `check`).
    """
    decoder = _decoders.get(cls) or check(cls)
    try:
        return decoder.decode(data)  # type: ignore[no-any-return]
    except (msgspec.DecodeError, ValueError, TypeError, RecursionError) as error:
        raise InputError(f"not a `{cls.type_name}` message: {error}") from error


def check(cls: type[Message]) -> "msgspec.msgpack.Decoder[Any]":
    """Make sure that messages of this class can be logged and read back; return the decoder.

    Raises
    ------
    KnotworkError
        A field's type has no binary form, or the class has no `type_name`.
    """
    name = f"{cls.__module__}.{cls.__qualname__}"
    if not cls.type_name:
        raise KnotworkError(f"message class {name} has no `type_name`", hint="set it as a ClassVar[str]")
    try:
        _check_type(msgspec.inspect.type_info(cls), cls.__qualname__, set())
        decoder = msgspec.msgpack.Decoder(cls, dec_hook=_decode_hook, ext_hook=_decode_extension)
    except (TypeError, NameError) as error:
        raise KnotworkError(
            f"message class {name} cannot be logged: {error}",
            hint="use numbers, bool, str, bytes, arrays, None, Literal, tuples, lists, dicts, dataclasses",
        ) from error
    _decoders[cls] = decoder
    return decoder


def json_schema(cls: type[Message]) -> bytes:
    """Return a JSON Schema that describes the fields of a message class to a person and to tools."""
    check(cls)
    return msgspec.json.encode(msgspec.json.schema(cls, schema_hook=_describe_array))


def _check_type(info: Any, where: str, seen: set[Any]) -> None:
    """Refuse custom types other than arrays; `info` is a node of `msgspec.inspect`."""
    if isinstance(info, msgspec.inspect.CustomType):
        if not _is_array(info.cls):
            raise TypeError(f"field {where} has type {getattr(info.cls, '__name__', info.cls)}")
        return
    fields = getattr(info, "fields", None)
    if fields is not None:
        if info.cls not in seen:
            seen.add(info.cls)
            for field in fields:
                _check_type(field.type, f"{where}.{field.name}", seen)
        return
    for part in ("item_type", "key_type", "value_type"):
        if (inner := getattr(info, part, None)) is not None:
            _check_type(inner, where, seen)
    for inner in (*getattr(info, "types", ()), *getattr(info, "item_types", ())):
        _check_type(inner, where, seen)


def _is_array(annotation: Any) -> bool:
    return (get_origin(annotation) or annotation) is np.ndarray


def _describe_array(annotation: Any) -> dict[str, Any]:
    if not _is_array(annotation):
        raise NotImplementedError
    return {"title": "ndarray", "description": f"MessagePack extension {ARRAY_EXTENSION}: {annotation}"}


def _unfit(message: Message, error: Exception) -> KnotworkError:
    return KnotworkError(f"a `{message.type_name}` message cannot be logged: {error}")


def _encode_hook(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        head = _heads.get((value.dtype, value.shape))
        if head is None:
            value = value.astype(value.dtype.newbyteorder("<"), copy=False)
            head = _array_head(value)
        return msgspec.msgpack.Ext(ARRAY_EXTENSION, head + value.tobytes())
    if isinstance(value, (np.bool_, np.integer, np.floating)):
        plain = value.item()
        if not isinstance(plain, np.generic):  # a long double stays what it is
            return plain
    raise TypeError(f"a value of type {type(value).__name__} has no binary form")


def _array_head(array: NDArray[Any]) -> bytes:
    if array.dtype.hasobject or array.dtype.names:
        raise TypeError(f"an array of dtype {array.dtype} has no binary form")
    name = array.dtype.newbyteorder("<").str.encode()
    head = struct.pack(f"<B{len(name)}sB{array.ndim}I", len(name), name, array.ndim, *array.shape)
    if len(_heads) >= _HEADS_KEPT:
        _heads.clear()
    _heads[array.dtype, array.shape] = head
    return head


def _decode_extension(code: int, data: memoryview) -> Any:
    if code != ARRAY_EXTENSION:
        raise ValueError(f"unknown MessagePack extension {code}")
    try:
        start = 1 + data[0]
        dtype = np.dtype(str(data[1:start], "ascii"))
        n_axes = data[start]
        shape = struct.unpack_from(f"<{n_axes}I", data, start + 1)
        start += 1 + 4 * n_axes
        if dtype.hasobject:
            raise ValueError("array of objects")
        # The copy is aligned and does not keep the log's buffer alive.
        array = np.ndarray(shape, dtype, data[start:]).copy() if 0 not in shape else np.empty(shape, dtype)
    except (struct.error, IndexError, TypeError, ValueError, SyntaxError, MemoryError) as error:
        raise ValueError(f"damaged array: {error}") from error
    array.flags.writeable = False
    return array


def _decode_hook(annotation: Any, value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        raise ValueError(f"an array was expected, found {type(value).__name__}")
    return value


_encoder = msgspec.msgpack.Encoder(enc_hook=_encode_hook)
_canonical = msgspec.msgpack.Encoder(enc_hook=_encode_hook, order="deterministic")
