"""The shipped file of a TurtleBot3 with a camera, against the emulated robot and rendered pictures of what it sees."""

import json
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("cv2")

import rendered_scene

from knotwork.core.emulator.turtlebot3 import Settings, TurtleBot3

PATIENCE = 300.0  # s; a loaded machine compiles for more than a minute
BACK = 0.1  # m


def test_it_takes_its_view_as_the_goal_and_backs_up(tmp_path):
    (tmp_path / "camera.yaml").write_text(rendered_scene.CALIBRATION)
    out = tmp_path / "out"
    with (
        TurtleBot3(Settings(world="arena", seed=1)) as robot,
        rendered_scene.Stream(rendered_scene.Scene(), robot.pose) as film,
    ):
        sets = (
            f"vars.base={robot.base_path}",
            f"vars.device={film.address}",
            f"vars.calibration={tmp_path / 'camera.yaml'}",
            "nodes.base.safety.rearm=auto",  # a loaded machine pauses for longer than a base may be silent
        )
        command = [sys.executable, "-m", "knotwork", "run", "configs:turtlebot3-depth.yaml", "--out", str(out)]
        command += [part for text in sets for part in ("--set", text)]
        run = subprocess.Popen(command, stderr=subprocess.PIPE)
        farthest = 0.0
        give_up = time.monotonic() + PATIENCE
        while run.poll() is None and farthest > -BACK and time.monotonic() < give_up:
            time.sleep(0.1)
            farthest = min(farthest, robot.pose()[0])
        run.send_signal(signal.SIGINT)
        said = run.communicate(timeout=60)[1].decode()
        assert run.returncode == 0, said
        assert robot.robot.speeds == (0.0, 0.0)
    assert -0.33 < farthest <= -BACK, said
    assert "the goal is the view of this frame" in said
    counters = json.loads((out / "summary.json").read_text())["counters"]
    assert counters.get("camera", {}).get("lost_camera", 0) == 0
