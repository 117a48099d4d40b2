"""JSON views of small messages, so that a viewer can plot their fields; inf and NaN become null."""

from typing import Any

import msgspec
import numpy as np

from knotwork.core import codec
from knotwork.core.messages import Battery, CameraTwist, Imu, Message, Statistics, Twist, Wheels
from knotwork.core.views.table import View


def json_view(cls: type[Message]) -> View:
    """Return a view that shows every field of a message as JSON."""
    return View(f"knotwork.json.{cls.type_name}", "json", _schema(cls), _render)


def _render(message: Message) -> bytes:
    return _encoder.encode(message)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"a value of type {type(value).__name__} has no JSON form")


_encoder = msgspec.json.Encoder(enc_hook=_plain)


def _schema(cls: type[Message]) -> bytes:
    """Return a JSON Schema without references at its top: viewers want `type: object` there."""
    codec.check(cls)
    schema = msgspec.json.schema(cls, schema_hook=lambda _: {"type": "array", "items": {"type": "number"}})
    name = schema.pop("$ref").rsplit("/", 1)[-1]
    top = schema["$defs"].pop(name)
    return msgspec.json.encode({**top, "$defs": schema["$defs"]})


JSON_VIEWS = {cls.type_name: [json_view(cls)] for cls in (Twist, CameraTwist, Imu, Wheels, Battery, Statistics)}
