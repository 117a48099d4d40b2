"""Every pipeline that comes with the package runs in a test; here those that no other test runs."""

import json
import os
import signal
import subprocess
import sys
import time
from importlib.resources import files
from pathlib import Path

import pytest

from knotwork.core.emulator.agilex_base import AgilexBase, AgilexSettings
from knotwork.core.emulator.turtlebot3 import Settings, TurtleBot3

SHORT = {
    "sim-goal": ["nodes.sim.duration=3"],
    "depth-servo": ["nodes.camera.duration=2"],
    "depth-single": ["nodes.camera.duration=2"],
    "depth-robot": ["nodes.camera.duration=2"],
}
ROBOTS = {"turtlebot3-burger": {}, "turtlebot3-waffle": {"model": "waffle"}}
ELSEWHERE = {  # and the split robot in test_split_turtlebot3
    "demo": "test_radish.py",
    "gallery": "test_curve_map.py",
    "radish": "test_radish.py",
    "radish-localize": "test_saved_maps.py",
    "turtlebot3-burger-path": "test_emulated_turtlebot3.py",
    "turtlebot3-dynamixel": "test_emulated_turtlebot3.py",
}
VALIDATED = {"turtlebot3-depth"}  # it needs a camera that looks at the world in which its base drives


def test_no_pipeline_is_left_out():
    shipped = {e.name.removesuffix(".yaml") for e in (files("knotwork") / "configs").iterdir() if e.is_file()}
    assert shipped - {"__init__.py"} == {*SHORT, *ROBOTS, *ELSEWHERE, "agilex"} | VALIDATED
    for name, file in ELSEWHERE.items():
        assert name in (Path(__file__).parent / file).read_text()


@pytest.mark.parametrize("name", SHORT)
def test_it_runs_for_a_moment(name, knotwork, tmp_path):
    done = knotwork("run", f"configs:{name}", "--set", SHORT[name][0], "--out", tmp_path, "--json")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["exit_code"] == 0
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) > 10_000


def runs_with_a_lidar(name, out, sets):
    argv = [part for text in [*sets, "nodes.drive=null"] for part in ("--set", text)]
    command = [sys.executable, "-m", "knotwork", "run", f"configs:{name}", *argv, "--out", str(out), "--quiet"]
    run = subprocess.Popen(command, stderr=subprocess.PIPE)
    online, give_up = out / "trajectory.online.tum", time.monotonic() + 90.0
    while run.poll() is None and time.monotonic() < give_up:
        if online.exists() and online.stat().st_size > 500:
            break
        time.sleep(0.1)
    run.send_signal(signal.SIGINT)
    said = run.communicate(timeout=60)[1].decode()
    assert run.returncode == 0, said
    assert len(online.read_text().splitlines()) > 5, said


@pytest.mark.parametrize("name", ROBOTS)
def test_it_runs_with_the_robot(name, tmp_path):
    with TurtleBot3(Settings(world="apartment", seed=1, **ROBOTS[name])) as robot:
        runs_with_a_lidar(name, tmp_path, [f"vars.lidar={robot.lidar_path}", f"vars.base={robot.base_path}"])


def test_it_runs_with_a_base_on_the_bus(tmp_path):
    port = 20_000 + os.getpid() % 20_000  # others on this machine may emulate as well
    bus = {"interface": "udp_multicast", "channel": "239.74.163.2", "udp_port": port}
    with AgilexBase(AgilexSettings(world="apartment", port=port)), TurtleBot3(Settings(world="apartment")) as robot:
        sets = [f"nodes.base.{key}={value}" for key, value in bus.items()]
        runs_with_a_lidar("agilex", tmp_path, [f"vars.lidar={robot.lidar_path}", *sets])
