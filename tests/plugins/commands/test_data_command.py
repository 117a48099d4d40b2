"""`knotwork data` against a server of our own and recordings of every format."""

import gzip
import hashlib
import threading
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
import yaml

from knotwork.core.cli.main import main
from knotwork.core.log.reader import Log

RANGES = " ".join(f"{1 + 0.01 * i:.2f}" for i in range(180))
CARMEN = "# a comment\n" + "".join(f"FLASER 180 {RANGES} 0.{i} 0 0 0.{i} 0 0 {i}.5 host {i}.5\n" for i in range(10))


class Quiet(SimpleHTTPRequestHandler):
    asked: list[str] = []

    def do_GET(self):
        self.asked.append(self.path)
        super().do_GET()

    def log_message(self, *args):
        pass


@contextmanager
def serving(folder: Path):
    Quiet.asked = []
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=folder))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.fixture
def shop(tmp_path):
    """A server with one log, and a function that writes a catalogue naming it."""
    served = tmp_path / "served"
    served.mkdir()
    (served / "lab.clf").write_text(CARMEN)
    with serving(served) as address:

        def write(name="lab.clf", sha256=None, **more):
            file = {"url": f"{address}/{name}"} | ({} if sha256 is None else {"sha256": sha256})
            keys = {"summary": "a laboratory", "licence": "CC0-1.0", "driver": "carmen", "files": {"lab.clf": file}}
            path = tmp_path / "catalogue.yaml"
            path.write_text(yaml.safe_dump({"lab": keys | more}))
            return ["--catalogue", str(path)]

        yield write, served


def test_what_ships_is_a_catalogue(capsys):
    assert main(["data", "list"]) == 0
    said = capsys.readouterr().out
    assert "intel: Intel Research Lab" in said
    assert said.count("licence: ") == said.count("\n") / 2


def test_fetch_checks_pins_and_does_not_fetch_twice(tmp_path, shop, capsys):
    write, served = shop
    sums = hashlib.sha256(CARMEN.encode()).hexdigest()
    argv = ["data", "fetch", "lab", "--to", str(tmp_path / "data"), *write(sha256=sums)]
    assert main(argv) == 0
    path = tmp_path / "data" / "lab" / "lab.clf"
    assert path.read_text() == CARMEN
    said = capsys.readouterr().out
    assert "licence: CC0-1.0" in said
    assert f"{{plugin: carmen, path: {path}}}" in said
    assert main(argv) == 0
    assert Quiet.asked == ["/lab.clf"]
    # without a published checksum the first download's counts
    write()
    path.unlink()
    (served / "lab.clf").write_text(CARMEN + "ODOM changed\n")
    assert main(argv) == 1
    assert not path.exists()
    assert "what came is not the published file" in capsys.readouterr().err
    path.write_text("changed here")
    assert main(argv) == 1
    assert "is not the published file: its SHA-256 is" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("prepare", "says", "code"),
    [
        (lambda write: write("absent.clf"), "404", 1),
        (lambda write: write(sha256="0" * 64), "what came is not the published file", 1),
        (lambda write: write(licence=None), "licence", 2),
        (lambda write: ["--catalogue", "absent.yaml"], "No such file", 2),
    ],
)
def test_what_cannot_be_fetched_is_one_line_and_leaves_no_file(tmp_path, shop, capsys, prepare, says, code):
    argv = prepare(shop[0])
    assert main(["data", "fetch", "lab", "--to", str(tmp_path / "data"), *argv]) == code
    errors = [line for line in capsys.readouterr().err.splitlines() if line.startswith("knotwork: ")]
    assert len(errors) == 1
    assert says in errors[0]
    assert not list((tmp_path / "data").rglob("*.clf"))


def test_an_unknown_name(capsys):
    assert main(["data", "fetch", "intle"]) == 2
    assert "there is no data set 'intle' (there are intel, " in capsys.readouterr().err


@pytest.mark.parametrize("packed", [False, True])
def test_carmen_to_mcap(tmp_path, capsys, packed):
    path = tmp_path / "lab.clf"
    path.write_bytes(gzip.compress(CARMEN.encode()) if packed else CARMEN.encode())
    assert main(["data", "info", str(path)]) == 0
    assert ": CARMEN log, " in capsys.readouterr().out
    assert main(["data", "convert", str(path), "--set", "mount=[0.1, 0, 0]"]) == 0
    log = Log(tmp_path / "lab.clf.mcap")
    scans = [m for _, m in log.messages(types={"scan"})]
    assert [m.stamp for m in scans] == [i * 10**9 + 5 * 10**8 for i in range(10)]
    assert scans[0].mount == (0.1, 0.0, 0.0)
    np.testing.assert_allclose(scans[0].ranges, [1 + 0.01 * i for i in range(180)], atol=1e-6)
    assert [m.pose[0] for _, m in log.messages(types={"odometry"})] == [pytest.approx(0.1 * i) for i in range(10)]
    capsys.readouterr()
    assert main(["data", "info", str(log.path)]) == 0
    assert "log.scan  scan  10" in capsys.readouterr().out


def test_a_bag_to_mcap(tmp_path, capsys):
    from ros_drive import Ros, check_drive, played
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores

    ros = Ros(Stores.ROS1_NOETIC)
    path = tmp_path / "lab.bag"
    with Writer(path) as writer:
        connections = {}
        for topic, name, time, message in ros.drive():
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=ros.store)
            writer.write(connections[topic], time, ros.store.serialize_ros1(message, name))
    assert main(["data", "info", str(path)]) == 0
    assert "/scan  scan  5" in capsys.readouterr().out
    assert main(["data", "convert", str(path), "--output", str(tmp_path / "lab.mcap")]) == 0
    given, _ = played(tmp_path, "mcap-log", tmp_path / "lab.mcap")
    check_drive(given)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"hello\n", "none of the known formats"),
        (b"\xa2mrpt::obs::CObservation2DRangeScan\x07", "a rawlog without scans and odometry"),
        (None, "no such file"),
    ],
)
def test_what_cannot_be_converted(tmp_path, capsys, content, says):
    path = tmp_path / "x"
    if content is not None:
        path.write_bytes(content)
    assert main(["data", "convert", str(path)]) == 2
    assert says in capsys.readouterr().err
