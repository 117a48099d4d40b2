"""The conformance kit on everything that ships."""

from pathlib import Path

from knotwork.core.conformance import (
    CommandSuite,
    DriverSuite,
    LocalizerSuite,
    MapSuite,
    ObserverSuite,
    PolicySuite,
    SinkSuite,
)
from knotwork.core.conformance.suite import PluginSuite
from knotwork.core.registry import Registry

FLASER = " ".join(f"{1 + 0.01 * i:.2f}" for i in range(180))


class TestCarmen(DriverSuite):
    plugin = "carmen"

    def files(self, folder: Path):
        lines = [f"FLASER 180 {FLASER} 0.{i} 0 0 0.{i} 0 0 {i}.5 host {i}.5\n" for i in range(10)]
        (folder / "log.clf").write_text("# a comment\n" + "".join(lines) + "FLASER 180 1.0")
        return {"path": str(folder / "log.clf")}


class TestSim2d(DriverSuite):
    plugin = "sim2d"
    config = {"duration": 4.0}


class TestEkf(ObserverSuite):
    plugin = "ekf"


class TestFollowPath(PolicySuite):
    plugin = "follow-path"
    config = {"waypoints": [[0, 0], [1, 0], [1, 1]], "loop": True}


class TestEvaluate(CommandSuite):
    plugin = "evaluate"


class TestLog(CommandSuite):
    plugin = "log"


class TestSplineSurface(MapSuite):
    plugin = "spline-surface"


class TestGaussNewton(LocalizerSuite):
    plugin = "gauss-newton"


class TestMcap(SinkSuite):
    plugin = "mcap"


class TestMapExport(SinkSuite):
    plugin = "map-export"


class TestMapImage(SinkSuite):
    plugin = "map-image"


class TestSummary(SinkSuite):
    plugin = "summary"


class TestTrajectory(SinkSuite):
    plugin = "trajectory"


def test_every_plugin_that_ships_has_its_suite():
    suites = {c.plugin for c in globals().values() if isinstance(c, type) and issubclass(c, PluginSuite) and hasattr(c, "plugin")}
    assert suites == set(Registry(third_parties=False).names())
