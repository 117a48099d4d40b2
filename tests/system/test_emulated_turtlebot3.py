"""The shipped pipelines and the doctor against the emulated robot."""

import json
import math
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from knotwork.core.emulator.agilex_base import AgilexBase, AgilexSettings
from knotwork.core.emulator.turtlebot3 import Settings, TurtleBot3
from knotwork.core.evaluation.tum import read_tum

KNOTWORK = [sys.executable, "-m", "knotwork"]
PATIENCE = 90.0  # s
DRIVEN = 0.6  # m


@pytest.mark.parametrize(
    ("config", "settings"),
    [
        ("turtlebot3-burger-path", {}),
        ("turtlebot3-dynamixel", {"base": "dynamixel", "lidar": "lds02"}),
    ],
    ids=["burger", "dynamixel"],
)
def test_the_robot_maps_while_it_follows_a_path(config, settings, tmp_path):
    subprocess.run([*KNOTWORK, "warm", f"configs:{config}.yaml"], check=True)  # compiles before the clock runs
    truth = tmp_path / "truth.tum"
    with TurtleBot3(Settings(world="apartment", truth=truth, seed=1, **settings)) as robot:
        out = tmp_path / "out"
        # a loaded machine pauses for longer than a lidar may be silent
        patient = ["nodes.base.safety.rearm=auto", "nodes.drive={plugin: follow-path, world: apartment}"]
        sets = [f"vars.lidar={robot.lidar_path}", f"vars.base={robot.base_path}", *patient]
        command = [*KNOTWORK, "run", f"configs:{config}.yaml", "--out", str(out), "--quiet"]
        run = subprocess.Popen([*command, *(part for text in sets for part in ("--set", text))], stderr=subprocess.PIPE)
        give_up = time.monotonic() + PATIENCE
        while robot.path_length < DRIVEN and run.poll() is None and time.monotonic() < give_up:
            time.sleep(0.1)
        run.send_signal(signal.SIGINT)
        said = run.communicate(timeout=60)[1].decode()
        assert run.returncode == 0, said
        assert robot.robot.speeds == (0.0, 0.0)
        assert robot.path_length >= DRIVEN, said
    summary = json.loads((out / "summary.json").read_text())
    assert summary["counters"]["lidar"]["rejected_packets"] == 0
    estimate, true = read_tum(out / "trajectory.online.tum"), read_tum(truth)
    assert len(estimate.stamps) > 10
    x, y = (np.interp(estimate.stamps, true.stamps, true.poses[:, i]) for i in (0, 1))
    error = np.hypot(estimate.poses[:, 0] - x, estimate.poses[:, 1] - y)
    assert math.sqrt(np.mean(error**2)) < 0.05
    assert {"log.mcap", "map.png", "map.pgm", "trajectory.tum"} <= {p.name for p in out.iterdir()}


def doctor(*arguments: str) -> tuple[int, list[dict[str, str]]]:
    done = subprocess.run([*KNOTWORK, "doctor", "--json", *arguments], capture_output=True, text=True, timeout=90)
    assert done.stderr == ""
    return done.returncode, json.loads(done.stdout)


@pytest.mark.parametrize(
    ("settings", "lidar", "base"),
    [
        ({"firmware": 4}, "LDS-01", "TurtleBot3 Burger, OpenCR firmware 4, battery 12.0 V"),
        ({"base": "dynamixel", "lidar": "lds02"}, "LDS-02", "XL430, id 1"),
        ({"model": "waffle", "lidar": "lds03", "spin_up": 0.1}, "LDS-03", "TurtleBot3 Waffle, OpenCR firmware 5"),
    ],
    ids=["burger", "dynamixel", "waffle"],
)
def test_the_doctor_recognises_what_is_plugged_in(settings, lidar, base):
    with TurtleBot3(Settings(world="arena", **settings)) as robot:
        code, found = doctor("--port", robot.lidar_path, "--port", robot.base_path)
        devices = [f for f in found if f["what"] in (robot.lidar_path, robot.base_path)]
        assert [f["level"] for f in devices if f["level"] == "problem"] == []
        assert any(f["what"] == robot.lidar_path and lidar in f["text"] for f in devices)
        assert any(f["what"] == robot.base_path and base in f["text"] for f in devices)
        assert any("plugin: " in f["mend"] for f in devices)
        assert code == int(any(f["level"] == "problem" for f in found))


def test_the_doctor_says_what_is_wrong(tmp_path):
    with TurtleBot3(Settings(world="arena")) as robot:
        robot.board.voltage = 10.9
        robot.stall("lidar")
        missing = str(tmp_path / "nothing")
        code, found = doctor("--port", robot.lidar_path, "--port", robot.base_path, "--port", missing)
    problems = {f["what"]: f["text"] for f in found if f["level"] == "problem"}
    assert code == 1
    assert problems[missing] == "no such device"
    assert "battery is low (10.9 V)" in problems[robot.base_path]
    assert "nothing known answers" in problems[robot.lidar_path]


def test_the_doctor_hears_a_base_on_the_bus():
    port = 43_113
    with AgilexBase(AgilexSettings(world="arena", interface="udp_multicast", port=port)):
        _, found = doctor("--can", "udp_multicast:239.74.163.2")
    assert any("AgileX base, 25.6 V" in f["text"] for f in found), found
