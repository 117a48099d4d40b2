"""What `knotwork replay` says of logs that are the same, are not, and cannot be told."""

import math
from dataclasses import replace

import numpy as np
import pytest

from knotwork.core.cli.main import main
from knotwork.core.log.recover import recover
from knotwork.core.messages import Odometry, Pose, Scan, Statistics
from knotwork.plugins.commands.replay.comparison import difference

SIM = (
    "pipeline: p\nnodes:\n  sim: {plugin: sim2d, duration: 2}\n  prior: {plugin: ekf}\n"
    "  odometry: {plugin: mcap, path: odometry.mcap, include: [sim.odometry]}\n"
    "  recorder: {plugin: mcap, chunk_size: 4096}\n"
)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    (folder / "run.yaml").write_text(SIM)
    assert main(["run", str(folder / "run.yaml"), "--out", str(folder), "--quiet"]) == 0
    return folder / "log.mcap"


def check(capsys, path, *more):
    capsys.readouterr()
    code = main(["replay", "--check", str(path), *more])
    said = capsys.readouterr()
    return code, said.out, said.err


def test_the_same_is_identical_and_leaves_nothing_behind(log, capsys):
    before = sorted(path.name for path in log.parent.iterdir())
    code, out, err = check(capsys, log)
    assert (code, err) == (0, "")
    assert out == f"{log}: identical: 101 messages (prior.prior 101)\n"
    assert sorted(path.name for path in log.parent.iterdir()) == before


def test_the_first_difference_has_stream_stamp_and_field(log, capsys):
    code, out, _ = check(capsys, log, "--set", "nodes.prior.start_sigma=[0.3, 0.3]")
    assert code == 1
    assert ": first difference after " in out
    assert "prior.prior, stamp " in out
    assert "field covariance[" in out


def test_a_log_cut_short_is_compared_as_far_as_it_goes(log, tmp_path, capsys):
    path = tmp_path / "cut.mcap"
    path.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    code, out, _ = check(capsys, path)
    assert code == 0, out
    assert ": identical: " in out
    whole = recover(path).path
    assert check(capsys, whole)[0] in (0, 1)  # it has an end now: the run may go on after it


def test_what_a_log_lacks_is_told(log, tmp_path, capsys):
    path = tmp_path / "hole.mcap"
    data = bytearray(log.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    code, out, _ = check(capsys, path)
    assert code in (0, 1)
    if code == 1:
        assert "before it the log lacks " in out or "first difference" in out


def test_a_replay_with_another_configuration(log, tmp_path, capsys):
    assert main(["replay", str(log), "--out", str(tmp_path), "--from", "0.5", "--to", "1.5", "--quiet"]) == 0
    capsys.readouterr()
    assert main(["log", "info", str(tmp_path / "log.mcap")]) == 0
    said = capsys.readouterr().out
    assert "/knotwork/prior/prior" in said
    assert "from 0.500 to 1.500" in said
    assert (tmp_path / "replay.yaml").is_file()


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["--from", "1", "--check"], "not with --from"),
        (["--set", "nodes.nobody.x=1", "--check"], "nobody"),
    ],
)
def test_wrong_arguments(log, capsys, argv, says):
    assert main(["replay", str(log), *argv]) == 2
    assert says in capsys.readouterr().err


def test_logs_that_cannot_be_checked(log, tmp_path, capsys):
    part = tmp_path / "part.mcap"
    assert main(["log", "cut", str(log), "--from", "1", "--output", str(part)]) == 0
    code, _, err = check(capsys, part)
    assert code == 2
    assert "is a later part of a run" in err
    only = tmp_path / "only.mcap"
    assert main(["log", "cut", str(log), "--streams", "prior.*", "--output", str(only)]) == 0
    code, _, err = check(capsys, only)
    assert code == 2
    assert "no message of its run's sources" in err
    foreign = tmp_path / "foreign.mcap"
    from mcap.writer import Writer

    with foreign.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    code, _, err = check(capsys, foreign)
    assert code == 2
    assert "does not say which pipeline wrote it" in err
    assert check(capsys, tmp_path / "absent.mcap")[0] == 2


SCAN = Scan(
    stamp=1, scan_id=0, ranges=np.array([1.0, np.nan, np.inf], np.float32), angle_min=0.0, angle_increment=0.1,
    range_min=0.0, range_max=9.0,
)  # fmt: skip


@pytest.mark.parametrize(
    ("a", "b", "says"),
    [
        (SCAN, SCAN, ""),
        (SCAN, replace(SCAN, time=0), "field time: logged -1, now 0"),
        (replace(SCAN, seq=4), replace(SCAN, seq=5), ""),
        (SCAN, replace(SCAN, ranges=np.array([1.0, np.nan, 2.0], np.float32)), "field ranges[2]: logged inf, now 2.0"),
        (SCAN, replace(SCAN, ranges=SCAN.ranges[:2]), "field ranges: logged float32 (3,), now float32 (2,)"),
        (SCAN, replace(SCAN, mount=(0.0, 0.0, 0.1)), "field mount: logged (0.0, 0.0, 0.0), now (0.0, 0.0, 0.1)"),
        (SCAN, replace(SCAN, angle_min=-0.0), "field angle_min: logged 0.0, now -0.0"),
        (Pose(stamp=0, role="prior", pose=np.zeros(3)), Pose(stamp=0, role="prior", pose=np.zeros(3)), ""),  # NaN in it
        (
            Odometry(stamp=0, pose=np.zeros(3)),
            Odometry(stamp=0, pose=np.zeros(3), twist=np.zeros(3)),
            "field twist: logged None, now array(",
        ),
        (
            Statistics(stamp=0, data={"a": [1, math.pi]}),
            Statistics(stamp=0, data={"a": [1, 3.0]}),
            "field data: logged {",
        ),
    ],
)
def test_differences_are_bit_by_bit(a, b, says):
    found = difference(a, b)
    assert found.startswith(says)
    assert bool(found) == bool(says)
