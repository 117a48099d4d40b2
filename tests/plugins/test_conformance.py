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


class TestGazeboText(DriverSuite):
    plugin = "gazebo-text"

    def files(self, folder: Path):
        ranges = " ".join(f"{1 + 0.001 * i:.3f}" for i in range(360))
        lines = [f"0.{i} 0 0.1 0 6.26573 0.017453 {ranges}\n" for i in range(10)]
        (folder / "log.txt").write_text("".join(lines))
        return {"path": str(folder / "log.txt")}


class TestMinesrover(DriverSuite):
    plugin = "minesrover"

    def files(self, folder: Path):
        lines = (f"{1_000_000 + 100_000 * i} 0 {7 * i} {9 * i} {'0 ' * 20}{'1500 ' * 682}0\n" for i in range(10))
        (folder / "log.dat").write_text("".join(lines))
        return {"path": str(folder / "log.dat")}


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


class TestDemo(CommandSuite):
    plugin = "demo"


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
    classes = [c for c in globals().values() if isinstance(c, type) and issubclass(c, PluginSuite)]
    suites = {c.plugin for c in classes if hasattr(c, "plugin")}
    assert suites == set(Registry(third_parties=False).names())
