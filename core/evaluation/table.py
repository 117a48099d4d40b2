"""Number tables in text files, their first columns times, read to exact nanoseconds."""

from pathlib import Path

import numpy as np

from knotwork.core.errors import InputError
from knotwork.core.log_file import LogFile
from knotwork.core.messages import F64, I64
from knotwork.core.stamps import parse_seconds

_LIMIT = 1e9  # metres; keeps squares and differences finite


def read_table(path: str | Path, times: int, widths: tuple[int, ...], expected: str) -> tuple[I64, F64, list[int]]:
    """Read whitespace-separated numbers from a plain, .gz or .xz file; `#` starts a comment line.

    Parameters
    ----------
    path
        File to read.
    times
        Number of leading columns that are times [s].
    widths
        Numbers of columns a file may have; every line has as many as the first.
    expected
        The format in words, for errors.

    Returns
    -------
    stamps : int64, shape (n, times)
        Nanoseconds, exact.
    values : float64, shape (n, columns - times)
        The other columns, all finite.
    numbers
        Line number of each row.

    Raises
    ------
    InputError
        Missing, unreadable, empty, damaged file or a line of another format.
    """
    file = LogFile(path, InputError)
    stamps: list[list[int]] = []
    rows: list[list[float]] = []
    numbers: list[int] = []
    try:
        for number, line in file.lines():
            fields = line.split()
            if not fields or fields[0].startswith(b"#"):
                continue
            if len(fields) not in widths:
                raise InputError(f"found {len(fields)} columns, expected {expected}", where=f"{path}:{number}")
            widths = (len(fields),)
            try:
                stamps.append([parse_seconds(text) for text in fields[:times]])
                row = [float(text) for text in fields[times:]]
            except ValueError:
                raise InputError(f"a field is not a number, expected {expected}", where=f"{path}:{number}") from None
            if not all(abs(value) < _LIMIT for value in row):
                raise InputError("a number is not finite or out of range", where=f"{path}:{number}")
            rows.append(row)
            numbers.append(number)
    finally:
        file.close()
    if file.damage:
        raise InputError(file.damage, where=str(path), hint="copy the file again")
    if not rows:
        raise InputError(f"no line in the file, expected {expected}", where=str(path), hint="check the path")
    return np.array(stamps, dtype=np.int64), np.array(rows, dtype=np.float64), numbers
