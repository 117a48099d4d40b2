"""The temporary folder of an emulated robot's links, and what killed emulators have left of theirs."""

import fcntl
import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

_PREFIX = "knotwork-emulator-"


class LinkFolder:
    """A temporary folder that is locked while its owner lives.

    The kernel lets go of the lock however the process ends; a folder that nobody holds is one that a killed
    process has left, and the next one that makes a folder removes it.

    Parameters
    ----------
    parent
        Where to make it; None: where temporary files go.

    Raises
    ------
    OSError
        It cannot be made.

    Attributes
    ----------
    path
        The folder.
    """

    def __init__(self, parent: Path | None = None) -> None:
        _sweep(Path(tempfile.gettempdir()) if parent is None else parent)
        while True:
            self.path = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=parent))
            with suppress(FileNotFoundError):  # another one took it for abandoned before it was locked
                self._descriptor = os.open(self.path, os.O_RDONLY)
                if _lock(self._descriptor) and self.path.exists():
                    return
                os.close(self._descriptor)

    def remove(self) -> None:
        """Remove it and everything in it."""
        if self._descriptor >= 0:
            shutil.rmtree(self.path, ignore_errors=True)
            os.close(self._descriptor)
            self._descriptor = -1


def _sweep(parent: Path) -> None:
    for folder in parent.glob(f"{_PREFIX}*"):
        with suppress(OSError):  # another user's, or gone meanwhile
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                if _lock(descriptor):
                    shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(descriptor)


def _lock(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
