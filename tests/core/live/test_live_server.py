import json
import re
import socket
import threading
import time
from http.client import HTTPConnection
from importlib.resources import files

import numpy as np
import pytest

from knotwork.core import messages as m
from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.live.scene import Scene
from knotwork.core.live.server import LiveServer, is_local


class Rig:
    def __init__(self, **settings):
        self.scene = Scene()
        self.commands = []
        settings = {"port": 0, "period": 0.02, "patience": 0.5} | settings
        self.server = LiveServer(self.scene, {"note": self.note}, **settings)
        self.server.start()

    def note(self, command):
        if "bad" in command:
            raise InputError("bad is not good")
        self.commands.append(command)

    def request(self, method, path, body=None, **headers):
        connection = HTTPConnection("127.0.0.1", self.server.port, timeout=10)
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        data = answer.read()
        connection.close()
        return answer.status, data

    def post(self, command, path="/command", **headers):
        return self.request("POST", path, json.dumps(command), **{"Content-Type": "application/json"} | headers)

    def stream(self, path="/stream"):
        raw = socket.create_connection(("127.0.0.1", self.server.port), timeout=10)
        raw.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{self.server.port}\r\n\r\n".encode())
        return raw


@pytest.fixture
def rig():
    made = []

    def make(**settings):
        made.append(Rig(**settings))
        return made[-1]

    yield make
    for each in made:
        each.server.stop()


def looks(raw):
    """Yield looks as a browser's EventSource would."""
    file = raw.makefile("rb")
    assert b"200" in file.readline()
    for line in file:
        if line.startswith(b"data: "):
            yield json.loads(line[6:])


def until(condition, seconds=10.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def event(number):
    return m.Event(stamp=number, node="n", level="info", text=f"line {number}").sealed(number, number)


def test_the_page_names_only_files_that_are_served(rig):
    rig = rig()
    status, page = rig.request("GET", "/")
    assert status == 200
    names = set(re.findall(r'(?:src|href)="([^"]+)"', page.decode()))
    for name in {f.name for f in (files("knotwork.core.live") / "page").iterdir()}:
        text = (files("knotwork.core.live") / "page" / name).read_text()
        names |= {found.removeprefix("./") for found in re.findall(r'from "([^"]+)"', text)}
        assert "http://" not in text.replace("http://www.w3.org/2000/svg", "")
        assert "https://" not in text
    assert len(names) >= 8
    assert all(rig.request("GET", f"/{name}")[0] == 200 for name in names)
    assert rig.request("GET", "/../server.py")[0] == 404


def test_looks_are_whole_first_and_then_only_news(rig):
    rig = rig()
    rig.scene.take("r.events", event(1))
    raw = rig.stream()
    stream = looks(raw)
    first = next(stream)
    assert first["reset"]
    assert [e[2] for e in first["events"]] == ["line 1"]
    rig.scene.take("r.events", event(2))
    later = next(look for look in stream if "events" in look)
    assert [e[2] for e in later["events"]] == ["line 2"]
    assert "reset" not in later
    raw.close()


def test_a_viewer_that_never_reads_is_dropped_and_the_others_go_on(rig):
    rig = rig()
    dropped = []
    rig.server.viewers.on_drop = lambda: dropped.append(1)
    deaf = socket.socket()
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    deaf.connect(("127.0.0.1", rig.server.port))
    deaf.sendall(f"GET /stream HTTP/1.1\r\nHost: 127.0.0.1:{rig.server.port}\r\n\r\n".encode())
    until(lambda: len(rig.server.viewers) == 1)
    good = rig.stream()
    stream = looks(good)
    next(stream)
    rng = np.random.default_rng(0)
    until(lambda: len(rig.server.viewers) == 2)
    feeding = threading.Event()

    def feed():
        while not feeding.wait(0.005):  # noise does not compress: half a megabyte a look
            cells = rng.integers(-1, 101, (600, 600)).astype(np.int8)
            grid = m.Grid(stamp=1, cells=cells, resolution=0.1, origin=(0, 0, 0))
            rig.scene.take("map.grid", grid.sealed(1, 1))

    thread = threading.Thread(target=feed)
    thread.start()
    seen = 0
    for look in stream:
        seen += "maps" in look
        if dropped:
            break
    feeding.set()
    thread.join()
    assert dropped == [1]
    assert rig.server.statistics()["viewers_dropped"] == 1
    assert len(rig.server.viewers) == 1
    assert seen > 1
    good.close()
    deaf.close()


def test_a_viewer_that_was_behind_gets_everything_anew(rig):
    rig = rig(patience=30.0)
    slow = rig.stream()
    stream = looks(slow)
    next(stream)
    rng = np.random.default_rng(0)
    viewer = rig.server.viewers._all[0]
    number = 0
    while not viewer.lacks:  # until its socket is full
        number += 1
        cells = rng.integers(-1, 101, (600, 600)).astype(np.int8)
        rig.scene.take("map.grid", m.Grid(stamp=1, cells=cells, resolution=0.1, origin=(0, 0, 0)).sealed(1, 1))
        rig.scene.take("r.events", event(number))
        assert number < 3000
        time.sleep(0.01)
    again = next(look for look in stream if look.get("reset"))
    assert again["events"][-1][2] == f"line {number}"
    slow.close()


def test_one_too_many(rig):
    rig = rig(most=1)
    first = rig.stream()
    next(looks(first))
    second = rig.stream()
    second.settimeout(10)
    data = b""
    while more := second.recv(4096):
        data += more
    assert b"data:" not in data
    assert rig.server.statistics()["viewers_refused"] == 1
    first.close()
    second.close()


def test_commands(rig):
    rig = rig()
    assert rig.post({"do": "note", "x": 1})[0] == 200
    assert rig.commands == [{"do": "note", "x": 1}]
    status, answer = rig.post({"do": "fly"})
    assert status == 400
    assert "'fly'" in json.loads(answer)["error"]
    assert json.loads(rig.post({"do": "note", "bad": 1})[1]) == {"error": "bad is not good"}
    for body in ("{", "[]", "3", '"note"', "{}", '{"do": {}}'):
        assert rig.request("POST", "/command", body, **{"Content-Type": "application/json"})[0] == 400
    assert rig.post({"do": "note", "x": "y" * 5000})[0] == 400
    assert rig.post({"do": "note"}, path="/elsewhere")[0] == 404
    assert len(rig.commands) == 1


@pytest.mark.parametrize(
    "headers",
    [
        {"Content-Type": "text/plain"},  # what a form on another site can send without asking
        {"Content-Type": "application/json", "Origin": "http://evil.example"},
        {"Content-Type": "application/json", "Host": "evil.example:8420"},  # a name that now points here
    ],
)
def test_another_sites_page_cannot_command(rig, headers):
    rig = rig()
    assert rig.request("POST", "/command", '{"do": "note"}', **headers)[0] == 403
    assert rig.commands == []
    assert rig.server.rejected == 1


def test_a_foreign_host_cannot_look(rig):
    rig = rig()
    assert rig.request("GET", "/stream", Host="evil.example")[0] == 403


def test_with_a_token(rig):
    rig = rig(host="127.0.0.1", token="secret-token")
    assert rig.request("GET", "/stream")[0] == 403
    assert rig.request("GET", "/stream?token=secret-tokem")[0] == 403
    assert rig.post({"do": "note"})[0] == 403
    assert rig.post({"do": "note"}, path="/command?token=secret-token")[0] == 200
    assert rig.post({"do": "note"}, **{"X-Knotwork-Token": "secret-token"})[0] == 200
    assert rig.server.address_with_token.endswith("?token=secret-token")
    assert rig.server.statistics()["requests_rejected"] == 3
    raw = rig.stream("/stream?token=secret-token")
    assert next(looks(raw))["reset"]
    raw.close()


def test_others_need_a_token():
    with pytest.raises(InputError, match="needs a token"):
        LiveServer(Scene(), {}, host="0.0.0.0")
    assert [is_local(host) for host in ("127.0.0.1", "::1", "localhost", "0.0.0.0", "192.168.1.2", "robot")] == [
        True, True, True, False, False, False,
    ]  # fmt: skip


def test_a_taken_port_is_said(rig):
    port = rig().server.port
    with pytest.raises(KnotworkError, match=f"127.0.0.1:{port}.*in use.*port 0"):
        LiveServer(Scene(), {}, port=port)
