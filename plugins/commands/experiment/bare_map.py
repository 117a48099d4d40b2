"""Maps outside of a run: built by name, given scans at exact poses."""

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from knotwork.core.bare_context import BareContext
from knotwork.core.contracts import Map
from knotwork.core.errors import InputError
from knotwork.core.messages import F64, Scan
from knotwork.core.registry import Registry
from knotwork.core.world.raycast import RayCaster


@dataclass(frozen=True, slots=True)
class Variant:
    """A map plugin with its own options; `single`: each beam of a scan is fused by itself."""

    plugin: str
    options: dict[str, Any] = field(default_factory=dict)
    single: bool = False


VARIANTS = {
    "surface": Variant("spline-surface"),
    # Each beam frees what it crosses, though another ended there; our grid lets hits win within a scan.
    "textbook": Variant("grid", {"interpolation": "nearest", "margin": 0.0}, single=True),
    "nearest": Variant("grid", {"interpolation": "nearest"}),
    "bilinear": Variant("grid", {"interpolation": "bilinear"}),
    "bicubic": Variant("grid", {"interpolation": "bicubic"}),
    "tsdf": Variant("tsdf"),
    "curve": Variant("spline-curve"),
    "gp": Variant("gp"),
}
COLOURS = {
    "surface": "tab:blue",
    "textbook": "tab:brown",
    "nearest": "0.45",
    "bilinear": "tab:orange",
    "bicubic": "tab:red",
    "tsdf": "tab:green",
    "curve": "tab:purple",
    "gp": "tab:pink",
}


@lru_cache(maxsize=1)
def _registry() -> Registry:
    return Registry()


def available(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the variants whose plugin is installed."""
    return tuple(name for name in names if _registry().find(VARIANTS[name].plugin) is not None)


def build_node(plugin: str, config: dict[str, Any], options: dict[str, Any] | None = None) -> Any:
    """Build a node of a plugin.

    Raises
    ------
    InputError
        There is no such plugin, or it cannot be used.
    """
    manifest = _registry().find(plugin)
    if manifest is None:
        raise InputError(
            f"the plugin {plugin!r} cannot be used: {_registry().why_not(plugin) or 'it is not installed'}"
        )
    own = None if manifest.options is None else manifest.options.model_validate(options or {})
    return _registry().load(manifest)(BareContext(plugin, manifest.config.model_validate(config), own))


def build_map(name: str, resolution: tuple[float, ...], **config: Any) -> Map:
    """Build an empty map of a variant; its kernels are compiled."""
    variant = VARIANTS[name]
    chart: Map = build_node(variant.plugin, {"resolution": resolution, "publish": 0.0, **config}, variant.options)
    chart.warm()
    return chart


def fused_as(name: str, scan: Scan) -> list[Scan]:
    """Return the scans as which a variant fuses one: itself, or each beam alone."""
    if not VARIANTS[name].single:
        return [scan]
    alone = np.full((len(scan.ranges), len(scan.ranges)), np.nan, np.float32)
    np.fill_diagonal(alone, scan.ranges)
    return [replace(scan, ranges=row) for row in alone]


CENTRE: F64 = np.zeros(3)


def distances(caster: RayCaster, pose: F64, beams: int) -> F64:
    """Return the distances (beams,) [m] to the first obstacle in each direction of a turn from a pose (3,)."""
    angles = float(pose[2]) + 2.0 * np.pi * np.arange(beams) / beams
    return caster.cast(np.tile(pose[:2], (beams, 1)), np.column_stack((np.cos(angles), np.sin(angles))))


def turn(ranges: F64, range_max: float) -> Scan:
    """Return a scan of a whole turn from the robot's origin; beam i at i / n of the turn."""
    return Scan(
        stamp=0,
        scan_id=0,
        ranges=ranges.astype(np.float32),
        angle_min=0.0,
        angle_increment=2.0 * np.pi / len(ranges),
        range_min=0.0,
        range_max=range_max,
    )
