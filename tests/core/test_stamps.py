import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core.stamps import format_seconds, parse_seconds

STAMPS = st.integers(-(2**62) + 1, 2**62 - 1)


@given(STAMPS)
def test_nanoseconds_survive_the_text(stamp):
    assert parse_seconds(format_seconds(stamp)) == stamp
    assert parse_seconds(format_seconds(stamp).encode()) == stamp


@given(st.integers(0, 2**31), st.integers(0, 999_999))
def test_six_digits_of_a_log_come_out_as_they_went_in(seconds, microseconds):
    text = f"{seconds}.{microseconds:06d}"
    assert parse_seconds(text) == seconds * 10**9 + microseconds * 1000
    assert format_seconds(parse_seconds(text)) == text


@pytest.mark.parametrize(
    ("text", "stamp"),
    [
        ("976052857.337284", 976052857337284000),  # a float is 48 ns off here
        ("1e3", 10**12),
        ("-.5", -500_000_000),
        ("0.0000000004", 0),
        ("0.0000000006", 1),
    ],
)
def test_texts(text, stamp):
    assert parse_seconds(text) == stamp


@pytest.mark.parametrize(
    "text", ["", "x", "nan", "inf", "-inf", "1e400", "1e999999999999999999999", "5e9", "1.2.3", b"\xff1"]
)
def test_what_is_no_time_is_a_value_error(text):
    with pytest.raises(ValueError, match="not a time"):
        parse_seconds(text)


@given(st.binary(max_size=40))
def test_any_bytes_give_a_stamp_or_a_value_error(text):
    with contextlib.suppress(ValueError):
        assert abs(parse_seconds(text)) <= 2**62
