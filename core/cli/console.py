"""What a person sees while a run goes on: a progress bar on a terminal, plain lines elsewhere."""

import sys
import time
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from knotwork.core.contracts import Level
    from knotwork.core.runtime import Run

_BAR = 30


class Console:
    """Prints reports at once and progress now and then, on standard error."""

    def __init__(self, quiet: bool) -> None:
        self.kept: list[str] = []
        self._quiet = quiet
        self._terminal = sys.stderr.isatty()
        self._period = 0.2 if self._terminal else 10.0
        self._done = Event()
        self._thread: Thread | None = None
        self._shown = False

    def report(self, node: str, level: "Level", text: str) -> None:
        """Print one report of a node."""
        line = f"{level}: {node}: {text}"
        self.kept.append(line)
        if level in ("warning", "error") or (level == "info" and not self._quiet):
            self.line(line)

    def line(self, text: str) -> None:
        """Print a line above the progress bar."""
        clear = "\r\x1b[K" if self._shown else ""
        sys.stderr.write(f"{clear}{text}\n")
        sys.stderr.flush()

    def follow(self, run: "Run") -> None:
        """Show the progress of a run until `close`."""
        if not self._quiet:
            self._thread = Thread(target=self._show, args=(run,), name="progress", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Stop showing progress."""
        self._done.set()
        if self._thread is not None:
            self._thread.join()
        if self._shown:
            sys.stderr.write("\r\x1b[K")

    def _show(self, run: "Run") -> None:
        begun = time.monotonic()
        while not self._done.wait(self._period):
            share = run.progress()
            wall = time.monotonic() - begun
            if self._terminal:
                filled = round((share or 0.0) * _BAR)
                bar = f"[{'#' * filled}{'.' * (_BAR - filled)}] {share:4.0%} " if share is not None else ""
                sys.stderr.write(f"\r\x1b[K{bar}{wall:.0f} s, {run.messages} messages")
                sys.stderr.flush()
                self._shown = True
            else:
                done = f"{share:.0%}, " if share is not None else ""
                sys.stderr.write(f"{done}{wall:.0f} s, {run.messages} messages\n")


def table(statistics: dict[str, Any]) -> str:
    """Render where the time went, per node."""
    lines = [f"{'node':<28}{'n':>9}{'mean ms':>10}{'p95 ms':>10}{'max ms':>10}{'own total s':>13}{'drops':>8}"]
    for name, row in statistics["nodes"].items():
        if row.get("n"):
            own = row["self_mean_ms"] * row["n"] / 1e3
            lines.append(
                f"{name:<28}{row['n']:>9}{row['mean_ms']:>10.3f}{row['p95_ms']:>10.3f}{row['max_ms']:>10.1f}"
                f"{own:>13.2f}{row.get('drops', 0) or '':>8}"
            )
    lines.append(
        f"start {statistics['startup_s']:.2f} s, run {statistics['wall_s']:.2f} s, "
        f"peak memory {statistics['peak_rss_mb']:.0f} MB"
    )
    return "\n".join(lines) + "\n"
