"""Say once, in one line, that kernels are being compiled: the first use on a machine takes seconds."""

import logging
from typing import Any

from numba.core import event

_PACKAGE = __name__.rpartition(".")[0]
_log = logging.getLogger(_PACKAGE)


class _Announcement(event.Listener):
    """Hears of every compilation in the process; speaks at the first one of this package."""

    done = False

    def on_start(self, event: Any) -> None:
        if not self.done and event.data["dispatcher"].py_func.__module__.startswith(_PACKAGE):
            self.done = True
            # Without a logging configuration this goes to stderr as it is.
            _log.warning("compiling B-spline kernels for this machine: once, a few seconds")

    def on_end(self, event: Any) -> None:
        """Nothing to say."""


def listen() -> None:
    """Speak at the first compilation from now on; silence it with the logger "knotwork.core.splines"."""
    event.register("numba:compile", _Announcement())  # type: ignore[no-untyped-call]
