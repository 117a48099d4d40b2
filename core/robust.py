"""Robust losses of whitened residuals, for the kernels of maps.

With e the residual over the loss's `scale` c: rho is the loss, in the units of the squared residual, and
w = d rho / d(r^2) its weight in Gauss-Newton's normal equations. All are r^2 near zero.
"""

import math

from knotwork.core.contracts import Loss
from knotwork.core.kernel import inlined

CAUCHY = 2
CODES: dict[Loss, int] = {"none": 0, "huber": 1, "cauchy": CAUCHY, "geman-mcclure": 3, "welsch": 4}


@inlined
def loss_terms(code: int, squared: float, scale: float) -> tuple[float, float]:
    """Return (rho, w) of a squared whitened residual."""
    c2 = scale * scale
    if code == CAUCHY:
        ratio = squared / c2
        return c2 * math.log1p(ratio), 1.0 / (1.0 + ratio)
    if code == 0 or squared == 0.0:
        return squared, 1.0
    if code == 1:
        size = math.sqrt(squared)
        if size <= scale:
            return squared, 1.0
        return 2.0 * scale * size - c2, scale / size
    if code == 3:
        ratio = 1.0 / (1.0 + squared / c2)
        return squared * ratio, ratio * ratio
    weight = math.exp(-squared / c2)
    return c2 * (1.0 - weight), weight
