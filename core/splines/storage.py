"""Curves and surfaces as .npz files: plain arrays, no pickle."""

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.errors import InputError, KnotworkError

VERSION = 1


def write(path: Path | str, kind: str, **arrays: Any) -> None:
    """Write arrays under a kind; compressed.

    Raises
    ------
    KnotworkError
        If the file cannot be written.
    """
    try:
        with Path(path).open("wb") as file:
            np.savez_compressed(file, kind=np.array(kind), version=np.array(VERSION), **arrays)
    except OSError as error:
        raise KnotworkError(f"cannot write: {error.strerror or error}", where=str(path)) from error


def read(path: Path | str, kind: str, *names: str) -> list[NDArray[Any]]:
    """Return the arrays `names` of a file of that kind.

    Raises
    ------
    InputError
        If the file is missing, damaged or of another kind.
    """
    try:
        with Path(path).open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            found, version = str(file["kind"]), int(file["version"])
            if found != kind or version > VERSION:
                raise InputError(
                    f"holds a {found} of version {version}, expected a {kind} up to {VERSION}", where=str(path)
                )
            return [file[name] for name in names]
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror or error}", where=str(path)) from error
    except (KeyError, ValueError, AttributeError, TypeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"is not a whole {kind} file ({error})", where=str(path)) from error
