"""Uniform B-splines, sparse and fast: curves and tiled surfaces. Usable alone.

Only the (degree + 1) or (degree + 1)^2 control points that act at a place are ever touched, in compiled
kernels: cost does not depend on how large a curve or surface is. See `docs/splines.md`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from knotwork.core.splines.curve import Curve
    from knotwork.core.splines.surface import Surface
    from knotwork.core.splines.tiles import TiledArray
    from knotwork.core.splines.uniform import UniformBasis

__all__ = ["Curve", "Surface", "TiledArray", "UniformBasis"]

_HOMES = {"Curve": "curve", "Surface": "surface", "TiledArray": "tiles", "UniformBasis": "uniform"}


def __getattr__(name: str) -> Any:
    """Import a class when it is first asked for: a surface map starts without the curves' kernels."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
