from collections import defaultdict
from pathlib import Path

import pytest
import yaml

from knotwork.core import config, graph
from knotwork.core.registry import Registry
from knotwork.core.runtime import Run


@pytest.fixture(scope="session")
def registry():
    return Registry(third_parties=False)


@pytest.fixture
def pipeline(tmp_path, registry):
    """Run a pipeline given as a dict of nodes; returns its result and the messages of each stream."""

    def run(nodes):
        file = tmp_path / "pipeline.yaml"
        file.write_text(yaml.safe_dump({"pipeline": "test", "nodes": nodes}))
        loaded = config.load(file, registry)
        execution = Run(loaded, graph.build(loaded), registry, Path(tmp_path / "out"))
        streams = defaultdict(list)
        execution.tap(lambda stream, message: streams[stream].append(message))
        return execution.execute(), streams

    return run


class DepthContext:
    """What a node sees of the runtime, and what it says to it."""

    name = "node"
    options = None

    def __init__(self, settings):
        self.config = settings
        self.emitted = []
        self.counts = {}
        self.reports = []
        self.time = 0

    def emit(self, port, message):
        self.emitted.append((port, message))

    def now(self):
        return self.time

    def every(self, period, call):
        self.timer = call

    def count(self, name, by=1):
        self.counts[name] = self.counts.get(name, 0) + by

    def report(self, level, text):
        self.reports.append((level, text))


@pytest.fixture
def context():
    return DepthContext
