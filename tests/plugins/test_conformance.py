"""The conformance kit on everything that ships."""

import socket
import struct
import threading
import uuid
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from ros_drive import Ros
from rosbags.rosbag1 import Writer as Bag
from rosbags.typesys import Stores

from knotwork.core.cli.main import main
from knotwork.core.clock import epoch
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
from knotwork.core.emulator.agilex_base import AgilexBase, AgilexSettings
from knotwork.core.emulator.turtlebot3 import Settings, TurtleBot3
from knotwork.core.messages import Odometry
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


class TestMcapLog(DriverSuite):
    plugin = "mcap-log"

    def files(self, folder: Path):
        out = folder / "run"
        if not out.exists():
            file = folder / "run.yaml"
            file.write_text(
                "pipeline: p\nnodes:\n  sim: {plugin: sim2d, duration: 2}\n  prior: {plugin: ekf}\n"
                "  recorder: {plugin: mcap}\n"
            )
            assert main(["run", str(file), "--out", str(out), "--quiet"]) == 0
        return {"path": str(out / "log.mcap")}


class TestRosbag(DriverSuite):
    plugin = "rosbag"

    def files(self, folder: Path):
        path = folder / "a.bag"
        if not path.exists():
            ros = Ros(Stores.ROS1_NOETIC)
            with Bag(path) as writer:
                connections = {}
                for topic, name, time, message in ros.drive():
                    if topic not in connections:
                        connections[topic] = writer.add_connection(topic, name, typestore=ros.store)
                    writer.write(connections[topic], time, ros.store.serialize_ros1(message, name))
        return {"path": str(path)}


class TestRawlog(DriverSuite):
    plugin = "rawlog"

    def files(self, folder: Path):
        pose = b"\x87CPose2D\x01" + struct.pack("<3d", 1.0, 2.0, 0.5) + b"\x88"
        tail = struct.pack("<I", 0) + struct.pack("<Q", 132_000_000_000_000_000) + b"\x88"
        (folder / "a.rawlog").write_bytes((b"\x94CObservationOdometry\x00" + pose + tail) * 10)
        return {"path": str(folder / "a.rawlog")}


class TestSim2d(DriverSuite):
    plugin = "sim2d"
    config = {"duration": 4.0}


class Emulated:
    """A suite whose device is emulated."""

    robot: TurtleBot3
    settings: ClassVar[dict[str, str]] = {}
    part = "base"

    @pytest.fixture(autouse=True)
    def emulated(self):
        with TurtleBot3(Settings(world="arena", **self.settings)) as self.robot:
            yield

    def files(self, folder: Path):
        return {"port": self.robot.lidar_path if self.part == "lidar" else self.robot.base_path}

    def use(self, protocol: str):
        return self

    def last_packet(self) -> int:
        return epoch()


class TestLds01(Emulated, DriverSuite):
    plugin = "lds01"
    part = "lidar"


class TestLds02(Emulated, DriverSuite):
    plugin = "lds02"
    part = "lidar"
    settings = {"lidar": "lds02"}


class TestOpenCr(Emulated, DriverSuite):
    plugin = "opencr"
    config = {"calibrate_gyro": False}


class TestDynamixelWheels(Emulated, DriverSuite):
    plugin = "dynamixel-wheels"
    settings = {"base": "dynamixel"}


class TestCanBase(Emulated, DriverSuite):
    plugin = "can-base"

    @pytest.fixture(autouse=True)
    def emulated(self):
        self.channel = uuid.uuid4().hex
        with AgilexBase(AgilexSettings(interface="virtual", channel=self.channel, world="arena")):
            yield

    def files(self, folder: Path):
        return {"interface": "virtual", "channel": self.channel}


class TestTeleopGamepad(PolicySuite):
    plugin = "teleop-gamepad"


class TestTeleopKeyboard(PolicySuite):
    plugin = "teleop-keyboard"


class TestDoctor(CommandSuite):
    plugin = "doctor"


class TestEmulate(CommandSuite):
    plugin = "emulate"


class TestEkf(ObserverSuite):
    plugin = "ekf"


class TestFollowPath(PolicySuite):
    plugin = "follow-path"
    config = {"waypoints": [[0, 0], [1, 0], [1, 1]], "loop": True}


class TestEvaluate(CommandSuite):
    plugin = "evaluate"


class TestAblate(CommandSuite):
    plugin = "ablate"


class TestDemo(CommandSuite):
    plugin = "demo"


class TestLog(CommandSuite):
    plugin = "log"


class TestReplay(CommandSuite):
    plugin = "replay"


class TestData(CommandSuite):
    plugin = "data"


class TestSplineSurface(MapSuite):
    plugin = "spline-surface"
    options = {"normals": False}  # so that g is the whole gradient of the cost


class TestSplineCurve(MapSuite):
    plugin = "spline-curve"
    options = {"normals": False}  # so that g is the whole gradient of the cost


class TestGridBilinear(MapSuite):
    plugin = "grid"
    options = {"normals": False}


class TestGridBicubic(MapSuite):
    plugin = "grid"
    config = {"resolution": [0.125, 0.05]}  # cells of 0.3 m move a wall by up to half of that
    options = {"normals": False, "interpolation": "bicubic"}


class TestGp(MapSuite):
    """Nothing is aligned with this map: what the kit asks of alignments does not apply."""

    plugin = "gp"
    config = {"resolution": [0.1]}
    scans = 6
    test_empty = test_normal_equations = test_gradient = test_costs_agree = test_jacobian = None
    test_pulls_towards_the_truth = test_fuse_false_changes_nothing = test_update_through_an_alignment = None
    test_poor_scans = test_save_and_load = test_damaged_file = None  # tests/plugins/maps/test_gp.py


class TestTsdf(MapSuite):
    plugin = "tsdf"
    options = {"normals": False}


class TestMapCommand(CommandSuite):
    plugin = "map"


class TestGaussNewton(LocalizerSuite):
    plugin = "gauss-newton"


class TestMcap(SinkSuite):
    plugin = "mcap"


class TestLive(SinkSuite):
    plugin = "live"
    config: ClassVar = {"port": 0}


class TestReport(SinkSuite):
    plugin = "report"


class TestFoxglove(SinkSuite):
    plugin = "foxglove"
    config: ClassVar = {"port": 0}


class TestZenohOut(SinkSuite):
    plugin = "zenoh-out"
    config: ClassVar = {"link": "alone", "drain": 0.1}


class TestRos2Out(SinkSuite):
    plugin = "ros2-out"
    config: ClassVar = {"topics": {"scan": ["n.scan"], "tf": ["n.odometry"], "map": ["n.grid"]}}


class OverZenoh(DriverSuite):
    """A suite whose other machine is a thread that gives odometry."""

    @pytest.fixture(autouse=True)
    def other_machine(self, knotwork_context):
        pytest.importorskip("zenoh")
        with socket.create_server(("127.0.0.1", 0)) as probe:
            self.endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        registry = Registry(third_parties=False)
        manifest = registry.find(self.sender)
        node = registry.load(manifest)(knotwork_context(manifest, self.sender_config | {"listen": [self.endpoint]}))
        node.open()
        done = threading.Event()

        def give():
            number = 0
            while not done.wait(0.02):
                number += 1
                message = Odometry(stamp=number, pose=np.array([0.01 * number, 0, 0]))
                node.on_message("base.odometry", message.sealed(number, number))

        thread = threading.Thread(target=give)
        thread.start()
        yield
        done.set()
        thread.join()
        node.stop_motion()
        node.finish()
        node.close()


class TestZenohIn(OverZenoh):
    plugin = "zenoh-in"
    sender = "zenoh-out"
    sender_config: ClassVar = {"link": "suite", "drain": 0.1}

    def files(self, folder: Path):
        streams = {"odometry": {"stream": "base.odometry", "message": "odometry"}}
        return {"link": "suite", "connect": [self.endpoint], "streams": streams}


class TestRos2In(OverZenoh):
    plugin = "ros2-in"
    sender = "ros2-out"
    sender_config: ClassVar = {"topics": {"odom": ["base.odometry"]}}

    def files(self, folder: Path):
        return {"connect": [self.endpoint], "topics": {"odometry": {"topic": "/odom", "message": "odometry"}}}


class Centred:
    def stick(self) -> tuple[float, float]:
        return 0.5, -0.5


class TestTeleopWeb(PolicySuite):
    plugin = "teleop-web"
    gives = False  # only a timer's tick makes it speak: tests/plugins/policies/test_teleop_web.py

    def use(self, protocol: str):
        return Centred()


class TestView(CommandSuite):
    plugin = "view"


class TestMapExport(SinkSuite):
    plugin = "map-export"


class TestMapImage(SinkSuite):
    plugin = "map-image"


class TestSummary(SinkSuite):
    plugin = "summary"


class TestTrajectory(SinkSuite):
    plugin = "trajectory"


CORNERS = {"0": [0.1, 0.1], "1": [-0.1, 0.1], "2": [-0.1, -0.1], "3": [0.1, -0.1]}


class TestSimCamera(DriverSuite):
    plugin = "sim-camera"
    config: ClassVar = {"points": [[0.1, 0.1, 1.5], [-0.1, 0.1, 1.2], [0.1, -0.1, 1.0]], "duration": 2.0}


class TestCamera(DriverSuite):
    plugin = "camera"

    def files(self, folder: Path):
        image = pytest.importorskip("PIL.Image")
        noise = np.random.default_rng(0).integers(0, 255, (60, 80)).astype(np.uint8)
        (folder / "images").mkdir()
        for i in range(3):
            image.fromarray(np.roll(noise, i, axis=1)).save(folder / "images" / f"{i}.png")
        (folder / "camera.yaml").write_text("{fx: 80, fy: 80, cx: 40, cy: 30}")
        return {"source": str(folder / "images"), "calibration": str(folder / "camera.yaml")}


class TestDepthEkf(ObserverSuite):
    plugin = "depth-ekf"


class TestDepthFixedGain(ObserverSuite):
    plugin = "depth-fixed-gain"


class TestTriangulation(ObserverSuite):
    plugin = "triangulation"


class TestVisualServo(PolicySuite):
    plugin = "visual-servo"
    config: ClassVar = {"goal": CORNERS, "solver": "compiled"}


class TestSinglePoint(PolicySuite):
    plugin = "single-point"


class TestActiveBase(PolicySuite):
    plugin = "active-base"
    config: ClassVar = {"goal": CORNERS}


class TestExperiment(CommandSuite):
    plugin = "experiment"


NEEDS_A_DEVICE = {"camera-live"}  # its frames are tested in tests/plugins/depth with a stand-in for the capture


def test_every_plugin_that_ships_has_its_suite():
    classes = [c for c in globals().values() if isinstance(c, type) and issubclass(c, PluginSuite)]
    suites = {c.plugin for c in classes if hasattr(c, "plugin")}
    assert suites | NEEDS_A_DEVICE == set(Registry(third_parties=False).names())
