"""The conformance kit: one pytest suite per kind of plugin, run on the built-ins and by any author.

    from knotwork.core.conformance import MapSuite

    class TestMine(MapSuite):
        plugin = "my-map"

Names are loaded on first use: pytest imports this package in every session of an environment that has
Knotwork, and must not pay for NumPy or pydantic there.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from knotwork.core.conformance.command_suite import CommandSuite as CommandSuite
    from knotwork.core.conformance.context import RecordingContext as RecordingContext
    from knotwork.core.conformance.driver_suite import DriverSuite as DriverSuite
    from knotwork.core.conformance.localizer_suite import LocalizerSuite as LocalizerSuite
    from knotwork.core.conformance.map_suite import MapSuite as MapSuite
    from knotwork.core.conformance.registry import ClosedRegistry as ClosedRegistry
    from knotwork.core.conformance.room import FixedPrior as FixedPrior
    from knotwork.core.conformance.room import Room as Room
    from knotwork.core.conformance.room_map import RoomMap as RoomMap
    from knotwork.core.conformance.samples import difference as difference
    from knotwork.core.conformance.sink_suite import SinkSuite as SinkSuite
    from knotwork.core.conformance.stream_suite import ObserverSuite as ObserverSuite
    from knotwork.core.conformance.stream_suite import PolicySuite as PolicySuite

_HOME = {
    "CommandSuite": "command_suite",
    "RecordingContext": "context",
    "DriverSuite": "driver_suite",
    "LocalizerSuite": "localizer_suite",
    "MapSuite": "map_suite",
    "ClosedRegistry": "registry",
    "FixedPrior": "room",
    "Room": "room",
    "RoomMap": "room_map",
    "difference": "samples",
    "SinkSuite": "sink_suite",
    "ObserverSuite": "stream_suite",
    "PolicySuite": "stream_suite",
}

__all__ = [
    "ClosedRegistry",
    "CommandSuite",
    "DriverSuite",
    "FixedPrior",
    "LocalizerSuite",
    "MapSuite",
    "ObserverSuite",
    "PolicySuite",
    "RecordingContext",
    "Room",
    "RoomMap",
    "SinkSuite",
    "difference",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
