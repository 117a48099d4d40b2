"""The table of views, filled with the core's when it is first asked."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

_TABLE: dict[str, list["View"]] = {}


@dataclass(frozen=True, slots=True)
class View:
    """One rendering of a message type under a schema that viewers know.

    Attributes
    ----------
    schema
        Name of the schema ("foxglove.LaserScan").
    encoding
        Of the messages: "protobuf" or "json".
    definition
        The schema itself: a FileDescriptorSet, or a JSON Schema.
    render
        Message to bytes; None leaves this message out.
    topic
        A topic shared by all streams ("/tf"); "" is the stream's own.
    places
        For transforms: the frame whose place the message states. A frame has one parent, so only
        the first stream that places a frame is shown.
    """

    schema: str
    encoding: Literal["protobuf", "json"]
    definition: bytes
    render: Callable[[Any], bytes | None]
    topic: str = ""
    places: Callable[[Any], str] | None = None

    @property
    def schema_encoding(self) -> str:
        """MCAP's name for the kind of `definition`."""
        return "protobuf" if self.encoding == "protobuf" else "jsonschema"


def register_view(message_type: str, view: View) -> None:
    """Add a view of a message type, by its `type_name`."""
    _core()
    _TABLE.setdefault(message_type, []).append(view)


def views(message_type: str) -> tuple[View, ...]:
    """Return the views of a message type; empty for a type without one."""
    _core()
    return tuple(_TABLE.get(message_type, ()))


def _core() -> None:
    if not _TABLE:
        from knotwork.core.views.foxglove import FOXGLOVE_VIEWS
        from knotwork.core.views.plain import JSON_VIEWS

        for table in (FOXGLOVE_VIEWS, JSON_VIEWS):
            for message_type, found in table.items():
                _TABLE.setdefault(message_type, []).extend(found)
