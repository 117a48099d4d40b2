import importlib
import inspect
import os
import sys
from types import SimpleNamespace

import pytest

from knotwork.core.cli import new
from knotwork.core.conformance import (
    CommandSuite,
    DriverSuite,
    LocalizerSuite,
    MapSuite,
    ObserverSuite,
    PolicySuite,
    SinkSuite,
)

SUITES = {
    "driver": DriverSuite,
    "map": MapSuite,
    "localizer": LocalizerSuite,
    "observer": ObserverSuite,
    "policy": PolicySuite,
    "sink": SinkSuite,
    "command": CommandSuite,
}


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """A freshly made plugin of each kind, importable: kind -> manifest and class."""
    folder = tmp_path_factory.mktemp("made")
    sources = []
    for kind in SUITES:
        new.write(f"kit-{kind}", kind, folder / kind)
        sources.append(str(folder / kind / "src"))
    before = os.environ.get("PYTHONPATH")
    sys.path[:0] = sources
    os.environ["PYTHONPATH"] = os.pathsep.join([*sources, before] if before else sources)
    found = {}
    for kind in SUITES:
        manifest = importlib.import_module(f"knotwork_kit_{kind}").MANIFEST
        module, _, name = manifest.impl.partition(":")
        found[kind] = SimpleNamespace(manifest=manifest, cls=getattr(importlib.import_module(module), name))
    yield found
    del sys.path[: len(sources)]
    if before is None:
        del os.environ["PYTHONPATH"]
    else:
        os.environ["PYTHONPATH"] = before


@pytest.fixture
def check(made, tmp_path, capsys):
    """Run one check of a kind's suite on a changed manifest or class."""

    def run(kind, name, *, manifest=None, cls=None, **members):
        if kind == "driver":
            members = {"config": {"duration": 2.0}} | members
        members["plugin"] = manifest or made[kind].manifest
        if cls is not None:
            members["implementation"] = lambda self: cls
        suite = type("TestIt", (SUITES[kind],), members)()
        test = getattr(suite, name)
        given = {"tmp_path": tmp_path, "capsys": capsys}
        test(**{parameter: given[parameter] for parameter in inspect.signature(test).parameters})

    return run
