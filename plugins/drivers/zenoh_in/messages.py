"""What a link says of itself."""

from dataclasses import dataclass
from typing import ClassVar

from knotwork.core.messages import Message
from knotwork.core.views import register_view
from knotwork.core.views.plain import json_view


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinkState(Message):
    """State of a link as its receiving end sees it.

    Attributes
    ----------
    link
        Its name.
    up
        The other end has answered within the last second.
    offset
        The other's clock minus this one's [s]; NaN before it is known.
    round_trip
        [s]; NaN before it is known.
    received, lost, late
        Messages so far; that the sender no longer had; that were long on their way.
    refused
        Commands that were too old, or whose age was not known yet.
    """

    type_name: ClassVar[str] = "link_state"

    link: str
    up: bool
    offset: float = float("nan")
    round_trip: float = float("nan")
    received: int = 0
    lost: int = 0
    late: int = 0
    refused: int = 0


register_view("link_state", json_view(LinkState))
