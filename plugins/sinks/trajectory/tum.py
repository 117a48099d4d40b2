"""TUM trajectory format: `stamp tx ty tz qx qy qz qw` a line, seconds and metres."""

import math


def seconds(stamp: int) -> str:
    """Return a stamp [ns] in seconds, exactly: six decimals, nine where the log has more than microseconds.

    A float would lose digits of a stamp since 1970.
    """
    whole, rest = divmod(abs(stamp), 1_000_000_000)
    sign = "-" if stamp < 0 else ""
    return f"{sign}{whole}.{rest:09d}" if rest % 1000 else f"{sign}{whole}.{rest // 1000:06d}"


def line(stamp: int, x: float, y: float, yaw: float) -> str:
    """Return the line of a planar pose: x, y [m], yaw [rad]."""
    half = 0.5 * math.remainder(yaw, math.tau)  # so that qw is not negative
    return f"{seconds(stamp)} {x:.6f} {y:.6f} 0 0 0 {math.sin(half):.9f} {math.cos(half):.9f}\n"


def stamp_of(text: str) -> int:
    """Return the stamp [ns] of a line, exactly."""
    whole, fraction = text.split(" ", 1)[0].lstrip("-").split(".")
    stamp = int(whole) * 1_000_000_000 + int(fraction.ljust(9, "0"))
    return -stamp if text.startswith("-") else stamp
