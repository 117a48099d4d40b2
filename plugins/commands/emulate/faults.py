"""Fault switches of the command line: which device, how much, when."""

from dataclasses import dataclass
from math import isfinite

from knotwork.core.emulator.turtlebot3 import Part
from knotwork.core.errors import InputError

PARTS: tuple[Part, ...] = ("lidar", "base")


@dataclass(frozen=True)
class Fault:
    """A fault of a device that begins at a time and may end.

    Attributes
    ----------
    part, kind
        "lidar" or "base"; "stall" or "unplug".
    at, length
        From the start [s], how long [s]; None: for good.
    """

    part: Part
    kind: str
    at: float
    length: float | None


def rates(option: str, texts: list[str]) -> dict[str, float]:
    """Read `P` or `DEVICE=P`: probabilities by device; the last word counts.

    Raises
    ------
    InputError
        Not a probability, or no such device.
    """
    out: dict[str, float] = dict.fromkeys(PARTS, 0.0)
    for text in texts:
        parts, value = _split(option, text)
        rate = _number(option, value, "a probability")
        if rate > 1.0:
            raise InputError(f"expected a probability from 0 to 1, found {value}", where=option)
        for part in parts:
            out[part] = rate
    return out


def timed(option: str, kind: str, texts: list[str]) -> list[Fault]:
    """Read `[DEVICE=]AT[:LENGTH]`, in seconds.

    Raises
    ------
    InputError
        Not a time, or no such device.
    """
    out = []
    for text in texts:
        parts, value = _split(option, text)
        at, colon, length = value.partition(":")
        start = _number(option, at, "a time in seconds")
        span = _number(option, length, "a length in seconds") if colon else None
        out += [Fault(part, kind, start, span) for part in parts]
    return out


def _split(option: str, text: str) -> tuple[tuple[Part, ...], str]:
    name, equals, value = text.rpartition("=")
    parts = tuple(part for part in PARTS if part == name) if equals else PARTS
    if not parts:
        raise InputError(f"no device {name!r}, expected one of {', '.join(PARTS)}", where=option)
    return parts, value


def _number(option: str, text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not (isfinite(value) and value >= 0.0):
        raise InputError(f"expected {what}, found {text!r}", where=option)
    return value
