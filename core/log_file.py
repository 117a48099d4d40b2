"""Lines of a text file, plain, gzip or xz by its content, read as a stream."""

import gzip
import lzma
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, cast

from knotwork.core.errors import DriverError, KnotworkError

_BLOCK = 1 << 16
_LINE_LIMIT = 1 << 20  # a file without line ends must not fill the memory
_DAMAGE = (EOFError, OSError, MemoryError, lzma.LZMAError, zlib.error)


class LogFile:
    """An open text file.

    Parameters
    ----------
    path
        File to read; a gzip or xz file is told by its first bytes, not by its name.
    error
        Class of the error for a file that cannot be opened.

    Attributes
    ----------
    damage
        Set when `lines` ended early: why the rest cannot be read (a cut or damaged packed file).
    """

    def __init__(self, path: str | Path, error: type[KnotworkError] = DriverError) -> None:
        self.path = Path(path)
        self.damage = ""
        try:
            self._raw = self.path.open("rb")
            try:
                self._stream = _unpacked(self._raw)
            except OSError:
                self._raw.close()
                raise
        except FileNotFoundError:
            raise error("no such file", where=str(path), hint="check the path") from None
        except IsADirectoryError:
            raise error(
                "is a directory, expected a file", where=str(path), hint="name the file in it"
            ) from None
        except (OSError, ValueError) as problem:
            reason = getattr(problem, "strerror", None) or str(problem)
            raise error(
                f"cannot be read: {reason}", where=str(path), hint="check the file's permissions"
            ) from None

    def lines(self) -> Iterator[tuple[int, bytes]]:
        """Yield line numbers from 1 and lines without their ends; a line past 1 MiB is cut there.

        Of a damaged file everything before the damage is given except the line that it cuts; then
        `damage` is set.
        """
        number = 0
        rest = b""
        skipping = False  # inside the tail of a line that was too long
        try:
            while block := self._stream.read1(_BLOCK):
                *whole, rest = (rest + block).split(b"\n")
                for line in whole:
                    if skipping:
                        skipping = False
                        continue
                    number += 1
                    yield number, line
                if skipping:
                    rest = b""
                elif len(rest) > _LINE_LIMIT:
                    number += 1
                    yield number, rest
                    rest = b""
                    skipping = True
        except _DAMAGE as problem:
            self.damage = f"damaged or cut off after line {number}: {problem}"
            return
        if rest:
            yield number + 1, rest

    def close(self) -> None:
        """Close the file; more than once does no harm."""
        self._stream.close()
        self._raw.close()


def _unpacked(raw: BinaryIO) -> gzip.GzipFile:
    # All three streams have `read1`, the only method used here; typing has no common name for them.
    head = cast("gzip.GzipFile", raw).peek(6)
    stream: object = raw
    if head.startswith(b"\x1f\x8b"):
        stream = gzip.GzipFile(fileobj=raw, mode="rb")
    elif head.startswith(b"\xfd7zXZ\x00"):
        stream = lzma.LZMAFile(raw, "rb")  # noqa: SIM115 (closed by close)
    return cast("gzip.GzipFile", stream)
