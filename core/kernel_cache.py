"""Where compiled kernels are kept, and the one line that says they are being made."""

import hashlib
import logging
import os
import shutil
from pathlib import Path
from typing import Any

from knotwork.core.lean_numba import event

_PACKAGE = __name__.partition(".")[0]
_log = logging.getLogger(f"{_PACKAGE}.kernels")


def folder() -> str:
    """Return the cache folder for the kernels as they are now.

    Numba notices a change of the file a kernel stands in, not of the files whose kernels it calls; a stale
    one may write outside its arrays. So the folder's name holds a fingerprint of all our sources, and
    folders of other fingerprints are removed.
    """
    root = Path(__file__).resolve().parent
    sources = (path for top in (root, root.parent / "plugins") for path in sorted(top.rglob("*.py")))
    digest = hashlib.sha256()
    for path in sources:
        state = path.stat()
        digest.update(f"{path}:{state.st_size}:{state.st_mtime_ns};".encode())
    name = f"kernels-{digest.hexdigest()[:16]}"
    for base in (root / "__pycache__", _user_cache()):
        if (base / name).is_dir() and os.access(base / name, os.W_OK):
            return str(base / name)
        try:
            (base / name).mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        for old in base.glob("kernels-*"):
            if old.name != name:
                shutil.rmtree(old, ignore_errors=True)
        return str(base / name)
    return ""  # nowhere to write: Numba looks for a place of its own


def _user_cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / _PACKAGE


class _Announcement(event.Listener):
    """Hears of every compilation in the process; speaks at the first one of ours."""

    done = False

    def on_start(self, event: Any) -> None:
        if not self.done and event.data["dispatcher"].py_func.__module__.startswith(_PACKAGE):
            self.done = True
            # Without a logging configuration this goes to stderr as it is.
            _log.warning("compiling kernels for this machine: once, up to half a minute (ahead: knotwork warm)")

    def on_end(self, event: Any) -> None:
        """Nothing to say."""


def announce() -> None:
    """Speak at the first compilation from now on; silence it with the logger "knotwork.kernels"."""
    event.register("numba:compile", _Announcement())  # type: ignore[no-untyped-call]
