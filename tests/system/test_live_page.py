"""The live page of real runs, in a real browser where there is one."""

import json
import re
import signal
import threading
import time
from http.client import HTTPConnection
from io import BytesIO

import pytest
from PIL import Image

from knotwork.core.log.digest import digest
from knotwork.core.log.reader import Log

chromium = pytest.importorskip("chromium", exc_type=ImportError)

DRIVEN = """\
pipeline: driven
nodes:
  sim: {plugin: sim2d, world: arena, duration: 600}
  prior: {plugin: ekf}
  map: {plugin: spline-surface, publish: 1}
  localizer: {plugin: gauss-newton, uses: {map: map, prior: prior}}
  drive: {plugin: teleop-web, speed: 0.2}
  live: {plugin: live, port: 0}
"""

TWO_MAPS = """\
pipeline: two-maps
nodes:
  sim: {plugin: sim2d, world: arena, duration: 600}
  prior: {plugin: ekf, inputs: {correction: localizer.pose}}
  map: {plugin: spline-surface, publish: 1}
  localizer: {plugin: gauss-newton, uses: {map: map, prior: prior}}
  cells: {plugin: grid, resolution: [0.4, 0.2], publish: 1}
  beside: {plugin: gauss-newton, uses: {map: cells, prior: prior}}
  live: {plugin: live, port: 0}
"""

STEPPED = """\
pipeline: stepped
nodes:
  sim: {plugin: sim2d, world: arena, duration: 3, inputs: {twist: drive.twist}}
  prior: {plugin: ekf}
  drive: {plugin: follow-path, world: arena, path: tour}
  live: {plugin: live, port: 0, paused: true}
  recorder: {plugin: mcap, include: [sim.*, prior.*, drive.*]}
"""


class Running:
    """A run in a process of its own, and where its page is."""

    def __init__(self, process):
        self.process = process
        self.lines = []
        self.address = ""
        for line in process.stderr:
            self.lines.append(line)
            if found := re.search(r"live at (http://\S+)", line):
                self.address = found[1]
                break
        assert self.address, "".join(self.lines)
        threading.Thread(target=lambda: [self.lines.append(line) for line in process.stderr], daemon=True).start()

    def post(self, **command):
        connection = HTTPConnection(self.address.split("/")[2], timeout=10)
        connection.request("POST", "/command", json.dumps(command), {"Content-Type": "application/json"})
        status = connection.getresponse().status
        connection.close()
        return status

    def end(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        self.process.communicate(timeout=60)
        return self.process.returncode


@pytest.fixture
def running(start, tmp_path):
    started = []

    def begin(text, name, *arguments):
        (tmp_path / f"{name}.yaml").write_text(text)
        process = start("run", tmp_path / f"{name}.yaml", "--out", tmp_path / name, *arguments)
        started.append(process)
        return Running(process)

    yield begin
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


def test_a_run_that_was_paused_and_stepped_gives_the_same_messages(running, tmp_path):
    free = running(STEPPED, "free")
    assert free.post(do="resume") == 200
    assert free.process.wait(120) == 0
    held = running(STEPPED, "held")
    for kind in ("scan", "odometry", ""):
        assert held.post(do="step", type=kind) == 200
        time.sleep(0.1)
    assert held.post(do="rate", rate=20) == 200
    assert held.post(do="resume") == 200
    time.sleep(0.05)
    assert held.post(do="pause") == 200
    assert held.post(do="rate", rate=None) == 200
    assert held.post(do="resume") == 200
    assert held.process.wait(120) == 0
    first, second = (tmp_path / name / "log.mcap" for name in ("free", "held"))
    assert digest(first) == digest(second)
    assert sum(1 for _ in Log(first).messages(types=["scan"])) > 10


@pytest.fixture
def browser(tmp_path):
    executable = chromium.find()
    if executable is None:
        pytest.skip("no Chromium here (apt install chromium)")
    pytest.importorskip("websockets")
    opened = chromium.Chromium(tmp_path / "profile", executable)
    yield opened
    opened.close()


def colours(picture: bytes) -> int:
    found = Image.open(BytesIO(picture)).convert("RGB").getcolors(1 << 24)
    return len(found)


def test_a_person_drives_and_looks(running, browser, tmp_path):
    run = running(DRIVEN, "driven", "--rate", "1")
    browser.open(run.address, 1600, 900)
    browser.until("window.knotwork && knotwork.state.drive && Object.keys(knotwork.state.maps).length", 120)
    browser.until("document.getElementById('link').textContent === 'live'")
    at = "knotwork.state.poses['localizer.pose'].at"
    assert browser.value(f"Math.hypot({at}[0], {at}[1])") < 0.05

    x, y = browser.middle("#stick")
    browser.mouse("mousePressed", x, y)
    browser.mouse("mouseMoved", x, y - 70)
    browser.until(f"{at}[0] > 0.25")  # forward is up
    assert browser.value("knotwork.state.twists['drive.twist'].vx") == pytest.approx(0.2)
    browser.mouse("mouseReleased", x, y - 70)
    browser.until("knotwork.state.twists['drive.twist'].vx === 0")
    assert browser.value("document.getElementById('stop').hidden") is False

    browser.click("#play")
    browser.until("knotwork.state.playback.paused")
    time.sleep(0.3)
    stood = browser.value("knotwork.state.time")
    time.sleep(0.3)
    assert browser.value("knotwork.state.time") == stood
    browser.click("#step")
    browser.until(f"knotwork.state.time > {stood}")
    assert browser.value("knotwork.state.time") < stood + 1

    browser.click("#fit")
    for width, height in ((1600, 900), (400, 800)):
        browser.size(width, height)
        time.sleep(0.4)
        picture = browser.picture(tmp_path / f"{width}.png")
        assert colours(picture) > 50
        assert browser.value("document.documentElement.scrollWidth") <= width
        for button in ("#stop", "#fit", "#plane"):
            x, y = browser.middle(button)
            assert 0 < x < width
            assert 0 < y < height
    tiles = "[...Object.values(knotwork.state.maps)[0].tiles.values()]"
    assert browser.value(f"{tiles}.every((t) => t.image.naturalWidth === 128) && {tiles}.length > 0")
    assert browser.errors == []

    browser.click("#play")
    run.end()
    assert not any("Traceback" in line for line in run.lines)
    browser.until("document.getElementById('link').textContent.startsWith('no news')")


def test_the_page_shows_the_map_that_is_chosen(running, browser, tmp_path):
    run = running(TWO_MAPS, "two", "--rate", "1")
    browser.open(run.address, 400, 800)
    browser.until("window.knotwork && Object.keys(knotwork.state.maps).length === 2", 120)
    browser.until("!document.getElementById('map').hidden")
    assert browser.value("[...document.getElementById('map').options].map((o) => o.value).sort().join()") == (
        "cells.grid,map.grid"
    )
    assert browser.value("knotwork.state.maps['cells.grid'].resolution") == pytest.approx(0.2)
    pictures = {}
    for name in ("map.grid", "cells.grid"):
        browser.value(
            f"(() => {{ const m = document.getElementById('map'); m.value = '{name}'; m.onchange(); return 0; }})()"
        )
        browser.until(f"knotwork.plane.shownMap() === '{name}'")
        time.sleep(0.4)
        pictures[name] = browser.picture(tmp_path / f"{name}.png")
    assert pictures["map.grid"] != pictures["cells.grid"]
    x, _ = browser.middle("#map")
    assert 0 < x < 400
    assert browser.errors == []
    run.end()
