"""Download a data set and check it; what is there already is not fetched again."""

import hashlib
import logging
import os
import sys
from pathlib import Path
from typing import Any

from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.files import write_atomic
from knotwork.plugins.commands.data.catalogue import DataSet, add_argument, catalogue

_SUMS = "SHA256SUMS"
_PATIENCE = 60.0  # s without a byte
_BLOCK = 1 << 20


def arguments(parser: Any) -> None:
    """Add the arguments."""
    parser.add_argument("name", metavar="NAME", help="a data set; `knotwork data list` shows them")
    parser.add_argument(
        "--to", metavar="DIR", help="folder for data sets, each in its own (default $KNOTWORK_DATA, else data)"
    )
    add_argument(parser)


def run(arguments: Any) -> int:
    """Fetch and say where it is."""
    known = catalogue(arguments.catalogue)
    chosen = known.get(arguments.name)
    if chosen is None:
        raise InputError(f"there is no data set {arguments.name!r}", hint=f"there are {', '.join(known)}")
    folder = Path(arguments.to or os.environ.get("KNOTWORK_DATA") or "data") / chosen.name
    for path in fetch(chosen, folder):
        sys.stdout.write(f"{path}\n")
    sys.stdout.write(f"licence: {chosen.licence}\n")
    if chosen.thanks:
        sys.stdout.write(f"{chosen.thanks}\n")
    if chosen.driver:
        first = folder / next(iter(chosen.files))
        sys.stdout.write(f"in a pipeline: log: {{plugin: {chosen.driver}, path: {first}}}\n")
    return 0


def fetch(chosen: DataSet, folder: Path) -> list[Path]:
    """Download the files of a data set into a folder.

    A file whose checksum is not known is pinned: its checksum is written to `SHA256SUMS` in the folder,
    and a later download must have it.

    Raises
    ------
    InputError
        `pooch` is not installed.
    KnotworkError
        A file cannot be downloaded or written, or is not the one that was published.
    """
    try:
        import pooch
        import requests
    except ModuleNotFoundError as error:
        raise InputError(f"fetching needs {error.name}", hint="pip install 'knotwork[data]'") from error
    pooch.get_logger().setLevel(logging.WARNING)
    pinned = _pinned(folder)
    out: list[Path] = []
    for name, file in chosen.files.items():
        path = folder / name
        wanted = file.sha256 or pinned.get(name)
        if path.is_file() and (found := sha256(path)) != wanted and wanted is not None:
            raise KnotworkError(
                f"is not the published file: its SHA-256 is {found}, expected {wanted}",
                where=str(path),
                hint="move it away to fetch it again",
            )
        if not path.is_file():
            sys.stderr.write(f"fetching {file.url}\n")
            try:
                pooch.retrieve(
                    file.url,
                    known_hash=None if wanted is None else f"sha256:{wanted}",
                    fname=name,
                    path=folder,
                    downloader=pooch.HTTPDownloader(timeout=_PATIENCE),
                )
            except (requests.RequestException, OSError) as error:
                raise KnotworkError(f"cannot be fetched: {_cause(error)}", where=file.url) from error
            except ValueError as error:  # the checksum
                raise KnotworkError(
                    f"what came is not the published file (SHA-256 {wanted} expected); nothing is kept",
                    where=file.url,
                    hint="try again; if it stays so, the file was changed at its source",
                ) from error
        pinned[name] = sha256(path)
        out.append(path)
    write_atomic(folder / _SUMS, "".join(f"{sums}  {name}\n" for name, sums in sorted(pinned.items())).encode())
    return out


def sha256(path: Path) -> str:
    """Return the checksum of a file."""
    total = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            total.update(block)
    return total.hexdigest()


def _pinned(folder: Path) -> dict[str, str]:
    try:
        lines = (folder / _SUMS).read_text().splitlines()
    except (OSError, UnicodeDecodeError):
        return {}
    return {name: sums for sums, _, name in (line.partition("  ") for line in lines) if name}


def _cause(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
