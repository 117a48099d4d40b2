"""Record, replay, identical: a live session, a simulation in parts, a recorded log."""

import re
import signal
import time

import pytest

from knotwork.core.cli.main import main
from knotwork.core.emulator.turtlebot3 import Settings, TurtleBot3
from knotwork.core.log.digest import digest
from knotwork.core.log.reader import Log

ESTIMATES = frozenset({"prior.prior", "prior.transform", "localizer.pose", "map.grid", "drive.twist"})


def identical(capsys, path) -> dict[str, int]:
    """Check a log; return what was compared."""
    assert main(["replay", "--check", str(path)]) == 0
    said = capsys.readouterr().out
    assert ": identical: " in said
    return {stream: int(n) for stream, n in re.findall(r"(\w+\.\w+) (\d+)[,)]", said)}


@pytest.mark.data
def test_a_part_of_a_recorded_log_is_the_same_again(tmp_path, data, capsys):
    out, again = tmp_path / "out", tmp_path / "again"
    log = f"vars.log={data / 'intel' / 'intel.clf.xz'}"
    argv = ["--set", log, "--set", "nodes.log.limit=60", "--out", str(out), "--quiet"]
    assert main(["run", "configs:radish.yaml", *argv]) == 0
    assert identical(capsys, out / "log.mcap")["localizer.pose"] == 60
    assert main(["replay", str(out / "log.mcap"), "--out", str(again), "--quiet"]) == 0
    assert digest(again / "log.mcap") == digest(out / "log.mcap")
    assert (again / "trajectory.tum").read_bytes() == (out / "trajectory.tum").read_bytes()


def test_a_simulation_in_parts_is_the_same_again(tmp_path, capsys):
    file = tmp_path / "sim.yaml"
    file.write_text(
        "pipeline: sim\nnodes:\n"
        "  sim: {plugin: sim2d, world: apartment, duration: 6}\n"
        "  prior: {plugin: ekf}\n"
        "  drive: {plugin: follow-path, world: apartment, path: tour}\n"
        "  recorder: {plugin: mcap, split_time: 2, exclude: [sim.wheels]}\n"
    )
    out = tmp_path / "out"
    assert main(["run", str(file), "--out", str(out), "--quiet"]) == 0
    logs = sorted(out.glob("log.*.mcap"))
    assert [path.name for path in logs] == [f"log.{part:04d}.mcap" for part in range(4)]
    assert identical(capsys, out / "log.*.mcap").keys() == {"prior.prior", "drive.twist"}
    whole = tmp_path / "whole.mcap"
    assert main(["log", "merge", *map(str, logs), "--output", str(whole)]) == 0
    assert main(["log", "check", *map(str, logs), str(whole)]) == 0
    capsys.readouterr()
    identical(capsys, whole)
    assert sum(1 for _ in Log(whole).messages(streams={"sim.scan"})) == 30
    # only its sources, into a pipeline of the user's own
    raw = tmp_path / "raw.mcap"
    assert main(["log", "cut", str(whole), "--streams", "sim.*", "--output", str(raw)]) == 0
    other = tmp_path / "other.yaml"
    other.write_text(
        f"pipeline: other\nnodes:\n  log: {{plugin: mcap-log, path: {raw}}}\n  prior: {{plugin: ekf}}\n"
        "  recorder: {plugin: mcap}\n"
    )
    assert main(["run", str(other), "--out", str(tmp_path / "other"), "--quiet"]) == 0
    streams = frozenset({"prior.prior"})
    first = [m.pose.tolist() for _, m in Log(whole).messages(streams=streams)]
    assert [m.pose.tolist() for _, m in Log(tmp_path / "other" / "log.mcap").messages(streams=streams)] == first


def test_a_live_session_replayed_gives_the_estimates_it_had(tmp_path, start, capsys):
    log = tmp_path / "live" / "log.mcap"
    with TurtleBot3(Settings(world="apartment", seed=1)) as robot:
        sets = (f"vars.lidar={robot.lidar_path}", f"vars.base={robot.base_path}", "nodes.base.safety.rearm=auto")
        # a map that publishes by a timer: when it fired is in the log, too
        sets += ("nodes.map.publish=1.5", "nodes.base.calibrate_gyro=false")
        live = start(
            "run", "configs:turtlebot3-burger-path.yaml", "--out", log.parent, "--quiet",
            *(part for text in sets for part in ("--set", text)),
        )  # fmt: skip
        with live:
            give_up = time.monotonic() + 240
            while robot.path_length < 0.4 and live.poll() is None and time.monotonic() < give_up:
                time.sleep(0.1)
            live.send_signal(signal.SIGINT)
            assert live.wait(60) == 0, live.stderr.read()
    compared = identical(capsys, log)
    assert compared.keys() == ESTIMATES
    assert compared["localizer.pose"] > 5
    assert compared["map.grid"] > 1
    again = tmp_path / "again"
    assert main(["replay", str(log), "--out", str(again), "--quiet"]) == 0
    assert digest(again / "log.mcap", streams=ESTIMATES) == digest(log, streams=ESTIMATES)
    capsys.readouterr()
    assert main(["replay", "--check", str(log), "--set", "nodes.localizer.iterations=1"]) == 1
    said = capsys.readouterr().out
    assert re.search(
        r"first difference after \d+ identical messages: localizer\.pose, stamp \d+\.\d+ s: field pose\[", said
    )
