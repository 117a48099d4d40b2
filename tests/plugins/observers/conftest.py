import os
from pathlib import Path

import pytest

from knotwork.plugins.observers.ekf import EkfConfig
from knotwork.plugins.observers.ekf.node import Ekf


class EkfContext:
    """What a node sees of the runtime, and what it says to it."""

    name = "prior"
    options = None

    def __init__(self, config):
        self.config = config
        self.emitted = []
        self.counts = {}
        self.reports = []

    def emit(self, port, message):
        self.emitted.append((port, message))

    def count(self, name, by=1):
        self.counts[name] = self.counts.get(name, 0) + by

    def report(self, level, text):
        self.reports.append((level, text))


@pytest.fixture(scope="session")  # a factory: hypothesis may call it for each example
def make_ekf():
    def make(**config):
        return Ekf(EkfContext(EkfConfig(**config)))

    return make


@pytest.fixture
def observer_data():
    root = Path(__file__).resolve().parents[3]
    path = Path(os.environ.get("KNOTWORK_DATA") or root / "../shared/data")
    if not path.is_dir():
        pytest.skip(f"no recorded logs at {path} (set KNOTWORK_DATA)")
    return path
