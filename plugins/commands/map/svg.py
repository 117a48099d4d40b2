"""Polylines in metres as a drawing: one unit of the drawing is a metre, up is +y."""

import numpy as np

from knotwork.core.messages import F64

_MARGIN = 0.5  # m
_STROKE = 0.03  # m


def svg(outlines: list[F64]) -> str:
    """Return an SVG document of polylines (n, 2) [m]."""
    drawn = [line for line in outlines if len(line) > 1]
    points = np.concatenate(drawn) if drawn else np.zeros((1, 2))
    x0, y0 = (points.min(axis=0) - _MARGIN).tolist()
    width, height = (points.max(axis=0) - (x0, y0) + _MARGIN).tolist()
    lines = "".join(
        f'<polyline points="{" ".join(f"{x:.3f},{-y:.3f}" for x, y in line.tolist())}"/>\n' for line in drawn
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{x0:.3f} {-y0 - height:.3f} {width:.3f} {height:.3f}" '
        f'width="{width:.3f}in" height="{height:.3f}in">\n'
        f'<g fill="none" stroke="black" stroke-width="{_STROKE}" stroke-linejoin="round">\n{lines}</g>\n</svg>\n'
    )
