import os
from collections import Counter
from pathlib import Path

import pytest

from knotwork.core.errors import KnotworkError


class LogContext:
    """What a log driver sees of the runtime, and what it says to it."""

    name = "log"
    options = None

    def __init__(self, config):
        self.config = config
        self.counts = Counter()
        self.reports = []

    def count(self, name, by=1):
        self.counts[name] += by

    def report(self, level, text):
        self.reports.append((level, text))


@pytest.fixture(scope="session")
def run_driver():
    """Run a driver over a file: its messages by port, in order, its context, and the error it ended with."""

    def run(driver, config, error=None):
        context = LogContext(config)
        node = driver(context)
        events = []
        try:
            node.open()
            for event in node.events():
                events.append(event)  # noqa: PERF402 (what came before an error counts)
        except KnotworkError as problem:
            if error is None or not isinstance(problem, error):
                raise
            context.error = str(problem)
        else:
            assert error is None, "the driver ended without an error"
        finally:
            node.close()
        return events, context

    return run


@pytest.fixture(scope="session")
def log_data():
    root = Path(__file__).resolve().parents[4]
    path = Path(os.environ.get("KNOTWORK_DATA") or root / "../shared/data")
    if not path.is_dir():
        pytest.skip(f"no recorded logs at {path} (set KNOTWORK_DATA)")
    return path
