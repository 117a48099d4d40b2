"""The shipped file of a TurtleBot3 with a camera, against the emulated robot and rendered pictures of what it sees."""

import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2")

import rendered_scene  # noqa: E402

from knotwork.core.emulator.turtlebot3 import Settings, TurtleBot3  # noqa: E402
from knotwork.core.evaluation.tum import read_tum  # noqa: E402
from knotwork.core.log.reader import Log  # noqa: E402

PATIENCE = 150.0  # s
# FFmpeg keeps half a second of a stream back; a camera on USB does not.
NO_BUFFER = {"OPENCV_FFMPEG_CAPTURE_OPTIONS": "fflags;nobuffer|flags;low_delay|probesize;32|analyzeduration;0"}


def test_it_backs_up_learns_the_depths_and_comes_back(tmp_path):
    (tmp_path / "camera.yaml").write_text(rendered_scene.CALIBRATION)
    out, truth = tmp_path / "out", tmp_path / "truth.tum"
    with (
        TurtleBot3(Settings(world="arena", seed=1, truth=truth)) as robot,
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
        run = subprocess.Popen(command, stderr=subprocess.PIPE, env=os.environ | NO_BUFFER)
        way = [robot.pose()]
        give_up = time.monotonic() + PATIENCE
        while run.poll() is None and time.monotonic() < give_up:
            time.sleep(0.1)
            way.append(robot.pose())
            farthest = min(x for x, _, _ in way)
            stands = len(way) > 50 and math.dist(way[-1][:2], way[-50][:2]) < 0.002
            if farthest < -0.03 and stands and way[-1][0] > 0.5 * farthest:
                break
        run.send_signal(signal.SIGINT)
        said = run.communicate(timeout=60)[1].decode()
        assert run.returncode == 0, said
    farthest = min(x for x, _, _ in way)
    assert -0.33 < farthest < -0.03, said  # 0.3 m at most, and what it rolls on
    x, y, yaw = way[-1]
    assert math.hypot(x, y) < 0.06, said
    assert abs(yaw) < 0.05, said

    messages = list(Log(out / "log.mcap").messages(streams=("depths.depths", "drive.state")))
    turned = next(m.stamp for stream, m in messages if stream == "drive.state" and m.phase > 1)
    depths = next(m for stream, m in messages if stream == "depths.depths" and m.stamp == turned)
    true = read_tum(truth)
    base = [np.interp(turned, true.stamps, true.poses[:, i]) for i in range(3)]
    known = rendered_scene.Scene.depth(depths.points, base, margin=0.04)
    certain = np.sqrt(depths.variance) < 0.1 * depths.chi
    wrong = np.abs(1 / (depths.chi * known) - 1)[np.isfinite(known) & certain]
    assert len(wrong) > 10
    assert np.median(wrong) < 0.1
