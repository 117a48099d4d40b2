"""What a person sees while runs go on: a bar on a terminal, a line for each run elsewhere; on standard error."""

import sys

from knotwork.core import clock

_BAR = 30


class Progress:
    """Counts runs.

    Parameters
    ----------
    total, kept
        Runs in all, and those that were finished before.
    quiet
        Failures only.
    """

    def __init__(self, total: int, kept: int, quiet: bool = False) -> None:
        self._total = total
        self._done = kept
        self._kept = kept
        self._failed = 0
        self._quiet = quiet
        self._terminal = sys.stderr.isatty() and not quiet
        self._begun = clock.monotonic()

    def ended(self, title: str, error: str, seconds: float | None) -> None:
        """Say that a run has ended."""
        self._done += 1
        self._failed += bool(error)
        took = f", {seconds:.1f} s" if seconds is not None else ""
        if error:
            self.line(f"{self._done}/{self._total} failed: {title}: {error}")
        elif not self._quiet:
            self.line(f"{self._done}/{self._total} {title}{took}")
        self.tick()

    def line(self, text: str) -> None:
        """Print a line above the bar."""
        clear = "\r\x1b[K" if self._terminal else ""
        sys.stderr.write(f"{clear}{text}\n")
        sys.stderr.flush()

    def tick(self) -> None:
        """Draw the bar again."""
        if not self._terminal:
            return
        seconds = (clock.monotonic() - self._begun) / 1e9
        fresh = self._done - self._kept
        left = f", {seconds / fresh * (self._total - self._done):.0f} s left" if fresh else ""
        filled = _BAR * self._done // max(self._total, 1)
        failed = f", {self._failed} failed" if self._failed else ""
        bar = f"[{'#' * filled}{'.' * (_BAR - filled)}] {self._done}/{self._total}{failed}, {seconds:.0f} s{left}"
        sys.stderr.write(f"\r\x1b[K{bar}")
        sys.stderr.flush()

    def close(self) -> None:
        """Take the bar away."""
        if self._terminal:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
