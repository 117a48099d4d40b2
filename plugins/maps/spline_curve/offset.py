"""The shift between the parameters of two curves along the same obstacle, (6.11) to (6.14) mended."""

import numpy as np

from knotwork.core.splines import Curve

_SAMPLES = 4  # in a knot interval
_ITERATIONS = 20


def estimate_offset(mapped: Curve, seen: Curve, start: float) -> tuple[float, float, float] | None:
    """Return o such that seen(tau) lies at mapped(tau + o), the mean distance left [m] and the overlap [m].

    Gauss-Newton on the sum over samples of |mapped(tau + o) - seen(tau)|^2, from o = `start`. None if the
    two do not overlap by a knot interval.
    """
    offset = start
    low, high = mapped.domain
    tau = np.linspace(*seen.domain, _SAMPLES * (len(seen.control) - seen.basis.degree) + 1)
    points = seen(tau)
    residual, inside = np.inf, np.zeros(len(tau), bool)
    for _ in range(_ITERATIONS):
        place = tau + offset
        inside = (place >= low) & (place <= high)
        if np.count_nonzero(inside) <= _SAMPLES:
            return None
        there, slope = mapped.with_derivative(place[inside])
        difference = there - points[inside]
        residual = float(np.sqrt((difference**2).sum(axis=1)).mean())
        step = -float((slope * difference).sum() / max(float((slope * slope).sum()), 1e-12))
        step = min(max(step, -mapped.basis.step), mapped.basis.step)
        offset += step
        if abs(step) < 1e-9:
            break
    return offset, residual, float(np.count_nonzero(inside) - 1) * float(tau[1] - tau[0])


def moved_to_lattice(curve: Curve, offset: float, smoothness: float) -> Curve:
    """Return `curve` with its parameter raised by `offset`, on knots at whole multiples of the interval.

    The pieces that fill whole intervals are fitted anew; weights go with their places.
    """
    step, degree = curve.basis.step, curve.basis.degree
    low, high = curve.domain
    tau = np.linspace(low, high, _SAMPLES * (len(curve.control) - degree) + 1)
    first, last = np.floor((low + offset) / step + 1e-9), np.ceil((high + offset) / step - 1e-9)
    fitted = Curve.fit(
        tau + offset, curve(tau), step, domain=(first * step, last * step), smoothness=smoothness * step**3
    )
    centres = fitted.basis.origin + step * (np.arange(len(fitted.control)) + 0.5 * (degree + 1))
    mine = curve.basis.origin + offset + step * (np.arange(len(curve.control)) + 0.5 * (degree + 1))
    return Curve(fitted.control, fitted.basis, weights=np.interp(centres, mine, curve.weights))
