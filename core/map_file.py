"""Map files: named arrays and facts in one file with a version and a checksum.

Layout: 16 bytes that name the format, the SHA-256 of everything after it, four bytes (little-endian)
with the length of a JSON header, the header, an .npz archive.
"""

import hashlib
import io
import json
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.errors import InputError
from knotwork.core.files import write_atomic

_MAGIC = b"knotwork map 1\r\n"
_DIGEST = 32

Arrays = dict[str, NDArray[Any]]


def write_map(path: Path, kind: str, version: int, facts: dict[str, Any], arrays: Arrays) -> None:
    """Write a map file: whole, or the old one stays.

    Parameters
    ----------
    kind, version
        Plugin's name and the version of what it stores.
    facts
        Anything JSON can hold.

    Raises
    ------
    KnotworkError
        If the file cannot be written.
    """
    header = json.dumps({"kind": kind, "version": version, "facts": facts}, sort_keys=True).encode()
    archive = io.BytesIO()
    np.savez_compressed(archive, **arrays)  # type: ignore[arg-type]
    body = len(header).to_bytes(4, "little") + header + archive.getvalue()
    write_atomic(path, _MAGIC + hashlib.sha256(body).digest() + body)


def read_map(path: Path, kind: str, version: int) -> tuple[dict[str, Any], Arrays]:
    """Return facts and arrays of a map file of this kind, up to this version.

    Raises
    ------
    InputError
        If the file is missing, no map file, damaged, or another map's.
    """
    found, number, facts, archive = _parse(path)
    where = str(path)
    if found != kind or number > version:
        raise InputError(
            f"holds a {found} map of version {number}, expected {kind} up to {version}",
            where=where,
            hint="load it with the plugin that saved it",
        )
    try:
        with np.load(io.BytesIO(archive), allow_pickle=False) as arrays:
            return facts, {name: arrays[name] for name in arrays.files}
    except (KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"is not a whole map file ({error})", where=where) from error


def describe_map(path: Path) -> tuple[str, int, dict[str, Any]]:
    """Return the plugin that saved a map file, the version of what it stores, and its facts.

    Raises
    ------
    InputError
        If the file is missing, no map file or damaged.
    """
    return _parse(path)[:3]


def _parse(path: Path) -> tuple[str, int, dict[str, Any], bytes]:
    """Return kind, version, facts and archive of a file whose checksum is right."""
    where = str(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read the map: {error.strerror or error}", where=where) from error
    if not data.startswith(_MAGIC):
        raise InputError("is not a map file of Knotwork", where=where, hint="expected one that `save` wrote")
    body = data[len(_MAGIC) + _DIGEST :]
    if hashlib.sha256(body).digest() != data[len(_MAGIC) : len(_MAGIC) + _DIGEST]:
        raise InputError(
            "is damaged: its checksum does not match", where=where, hint="cut short or changed after it was saved"
        )
    try:
        start = 4 + int.from_bytes(body[:4], "little")
        header = json.loads(body[4:start])
        return str(header["kind"]), int(header["version"]), dict(header["facts"]), body[start:]
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"is not a whole map file ({error})", where=where) from error
