"""However a run ends, what was logged stays readable, and the user sees one clear line."""

import json
import lzma
import resource
import signal
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader

from knotwork.core.log.reader import Log

BEAMS = " ".join(["1.00"] * 180)


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    """A robot that stands in a round room for 2000 scans, 400 s."""
    path = tmp_path_factory.mktemp("logs") / "round.clf"
    lines = (f"FLASER 180 {BEAMS} 0 0 0 0 0 0 {100 + i / 5:.6f} host {i / 5:.6f}\n" for i in range(2000))
    path.write_text("".join(lines))
    return path


@pytest.fixture
def pipeline(tmp_path, log) -> Path:
    file = tmp_path / "record.yaml"
    file.write_text(
        f"pipeline: record\nnodes:\n  log: {{plugin: carmen, path: {log}}}\n  prior: {{plugin: ekf}}\n"
        "  recorder: {plugin: mcap}\n  summary: {plugin: summary}\n"
    )
    return file


def wait_for_size(path: Path, size: int) -> None:
    deadline = time.monotonic() + 60
    while not (path.exists() and path.stat().st_size > size):
        assert time.monotonic() < deadline, f"{path} did not grow to {size} bytes"
        time.sleep(0.02)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_run_gracefully(start, pipeline, tmp_path, number):
    out = tmp_path / "out"
    process = start("run", pipeline, "--rate", "20", "--out", out)
    wait_for_size(out / "log.mcap", 10_000)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert number.name in err
    summary = json.loads((out / "summary.json").read_text())
    assert summary["complete"]
    with (out / "log.mcap").open("rb") as file:
        reader = make_reader(file)  # an ordinary reader opens it
        count = sum(1 for _ in reader.iter_messages(topics=["/knotwork/log/scan"]))
    assert count == summary["scans"] > 0


def test_a_killed_run_leaves_a_log_that_recover_makes_whole(start, knotwork, pipeline, tmp_path):
    out = tmp_path / "out"
    process = start("run", pipeline, "--rate", "20", "--out", out)
    wait_for_size(out / "log.mcap", 30_000)
    process.kill()
    process.communicate(timeout=60)
    done = knotwork("log", "recover", out / "log.mcap")
    assert done.returncode == 0, done.stderr
    recovered = next(out.glob("*recovered*"))
    with recovered.open("rb") as file:
        stamps = [m.log_time for _, _, m in make_reader(file).iter_messages(topics=["/knotwork/log/scan"])]
    assert len(stamps) > 50
    assert stamps == [round((100 + i / 5) * 1e9) for i in range(len(stamps))]  # from the first on, none missing


def test_a_full_disk_is_said_when_it_happens_and_at_the_end_and_loses_nothing_written(knotwork, pipeline, tmp_path):
    out = tmp_path / "out"
    size = 40_000

    def limit() -> None:  # the file system's answer to a full disk, for this process alone
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    done = knotwork("run", pipeline, "--out", out, preexec_fn=limit)
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    failed, lost = (line for line in done.stderr.splitlines() if line.startswith("error: recorder"))
    assert "File too large: what is written is kept" in failed
    assert "records were dropped (knotwork log recover" in lost
    kept = [m for _, m in Log(out / "log.mcap").messages(types=["scan"])]
    assert len(kept) > 20
    assert json.loads((out / "summary.json").read_text())["scans"] == 2000  # the estimators went on


def message(done) -> str:
    assert "Traceback" not in done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith("knotwork:")]
    assert len(lines) == 1, done.stderr
    return lines[0]


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("missing.clf", None, "missing.clf"),
        ("empty.clf", b"", "empty"),
        ("text.clf", b"these are no scans\n" * 50, "CARMEN"),
        ("binary.clf", bytes(range(256)) * 200, "CARMEN"),
        ("cut.clf.xz", lzma.compress(b"FLASER 1 1.0 0 0 0 0 0 0 1.0 h 1.0\n")[:20], "cut.clf.xz"),
    ],
)
def test_a_log_that_cannot_be_read_is_one_clear_line(knotwork, tmp_path, name, content, expected):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    done = knotwork("run", "configs:radish.yaml", "--set", f"vars.log={path}", "--out", tmp_path / "out")
    assert done.returncode in (1, 2)
    assert expected in message(done)


def test_a_folder_that_cannot_be_made_is_one_clear_line(knotwork, pipeline, tmp_path):
    (tmp_path / "file").write_text("in the way")
    done = knotwork("run", pipeline, "--out", tmp_path / "file" / "out")
    assert done.returncode == 2
    assert "cannot make or write the run's folder" in message(done)
