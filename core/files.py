"""Result files: whole or not there, never half."""

import os
from pathlib import Path

from knotwork.core.errors import KnotworkError


def write_atomic(path: Path, data: bytes) -> None:
    """Write a file so that a reader sees the old one or the new one, also after a crash.

    Raises
    ------
    KnotworkError
        It cannot be written (disk full, no permission, no such folder); the old file is as it was.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        try:
            with partial.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise KnotworkError(f"cannot write: {error.strerror}", where=str(path)) from error
