"""Time stamps between decimal seconds in a text and integer nanoseconds, without a float in between."""

from decimal import Decimal

_LIMIT = Decimal(2**62) / 10**9  # so that a difference of two stamps fits in 64 bits as well


def parse_seconds(text: str | bytes) -> int:
    """Return decimal seconds as nanoseconds, exactly (digits beyond the ninth are rounded).

    Raises
    ------
    ValueError
        Not a decimal number, or beyond +-2^62 ns (146 years).
    """
    if isinstance(text, bytes):
        text = text.decode("ascii", "replace")
    try:
        seconds = Decimal(text)
        if not -_LIMIT < seconds < _LIMIT:  # also refuses infinities; NaN raises
            raise ValueError
        return int(seconds.scaleb(9).to_integral_value())
    except (ArithmeticError, ValueError):
        raise ValueError(f"{text[:40]!r} is not a time in seconds") from None


def format_seconds(stamp: int) -> str:
    """Return nanoseconds as decimal seconds: six digits after the point, nine where six would lose some."""
    seconds, fraction = divmod(abs(stamp), 10**9)
    digits = f"{fraction:09d}"
    if digits.endswith("000"):
        digits = digits[:6]
    return f"{'-' if stamp < 0 else ''}{seconds}.{digits}"
