"""Uniform B-splines, sparse and fast: curves and tiled surfaces. Usable alone.

Only the (degree + 1) or (degree + 1)^2 control points that act at a place are ever touched, in compiled
kernels: cost does not depend on how large a curve or surface is. See `docs/splines.md`.
"""

from knotwork.core.splines.curve import Curve
from knotwork.core.splines.surface import Surface
from knotwork.core.splines.tiles import TiledArray
from knotwork.core.splines.uniform import UniformBasis

__all__ = ["Curve", "Surface", "TiledArray", "UniformBasis"]
