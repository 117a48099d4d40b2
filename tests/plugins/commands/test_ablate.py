"""Ablations end to end: on a small log, in this process, in others, on a local Dask cluster."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser
from pathlib import Path

import pytest

from knotwork.core.cli.main import main
from knotwork.core.errors import ConfigError
from knotwork.core.evaluation.relations import read_relations, score_relations
from knotwork.core.evaluation.tum import read_tum
from knotwork.core.registry import Registry
from knotwork.plugins.commands.ablate import engines
from knotwork.plugins.commands.ablate import job as job_module
from knotwork.plugins.commands.ablate.metrics import look_up
from knotwork.plugins.commands.ablate.plan import read_plan

CONFIGS = Path(__file__).parents[3] / "configs"
BASE = """pipeline: small
vars: {log: tour.clf}
nodes:
  log: {plugin: carmen, path: "${log}"}
  prior: {plugin: ekf}
  map: {plugin: spline-surface, resolution: [0.2, 0.1]}
  localizer: {plugin: gauss-newton, uses: {map: map, prior: prior}}
"""
ABLATION = """ablation: steps
description: two steps <on> a tour
base: small.yaml
vars: {data: .}
axes:
  data:
    - name: tour
      set: {vars.log: "${data}/tour.clf"}
      relations: "${data}/tour.relations"
      reference: "${data}/tour.txt"
  nodes.map.resolution: [[0.2, 0.1], [0.4]]
metrics:
  - trans_m
  - rot_deg
  - reference_m
  - scan_ms
  - map_bytes
  - scans
  - {name: updates, key: statistics.nodes.localizer.update.n}
"""


@pytest.fixture
def place(tour, tmp_path):
    """A folder with the log, a base and an ablation; the ablation's text can be given."""
    for file in tour.iterdir():
        (tmp_path / file.name).symlink_to(file)
    (tmp_path / "small.yaml").write_text(BASE)

    def write(text=ABLATION):
        (tmp_path / "a.yaml").write_text(text)
        return str(tmp_path / "a.yaml")

    write.folder = tmp_path
    return write


def ablate(place, *arguments, text=ABLATION, jobs="0"):
    """Run the command; returns exit code and results."""
    out = place.folder / "out"
    args = ["--out", str(out), "--set", f"vars.data={place.folder}", *arguments]
    code = main(["ablate", place(text), *args, *(["--jobs", jobs] if jobs else [])])
    return code, json.loads((out / "results.json").read_text())


class Page(HTMLParser):
    """Checks that tags are closed; collects what a page would load from elsewhere."""

    void = frozenset({"meta", "br", "img", "input", "link"})

    def __init__(self, text):
        super().__init__()
        self.open, self.links, self.tags = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.links += [v for k, v in attributes if k in ("src", "href") and not v.startswith("data:")]
        if tag not in self.void:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_an_ablation_from_file_to_report(place, capsys):
    code, results = ablate(place)
    out = place.folder / "out"
    assert code == 0
    fine, coarse = results["rows"]
    assert fine["names"] == {"data": "tour", "nodes.map.resolution": "[0.2, 0.1]"}
    for row in (fine, coarse):
        assert row["state"] == "done"
        # The score is what `knotwork evaluate` says of the stored trajectory.
        (run,) = row["runs"]
        expected = score_relations(
            read_tum(out / run["folder"] / "trajectory.tum"), read_relations(place.folder / "tour.relations")
        )
        assert row["metrics"]["trans_m"] == {
            "mean": expected["trans_abs_mean_m"], "std": expected["trans_abs_std_m"],
        }  # fmt: skip
        assert row["metrics"]["scans"]["mean"] == row["metrics"]["updates"]["mean"] == 25
        assert row["metrics"]["scan_ms"]["mean"] > 0
        assert (out / run["folder"] / "config.yaml").is_file()
    # The map corrects the odometry's 5 % (16 mm in a relation); knots of 0.4 m are too coarse for it.
    assert fine["metrics"]["trans_m"]["mean"] < 0.005 < coarse["metrics"]["trans_m"]["mean"]
    assert fine["metrics"]["reference_m"]["mean"] < 0.02
    assert fine["metrics"]["map_bytes"]["mean"] > coarse["metrics"]["map_bytes"]["mean"] > 0

    table = capsys.readouterr().out
    assert table.splitlines()[0].startswith("| data | nodes.map.resolution | translation [m] |")
    assert table.splitlines()[2].startswith("| tour | [0.2, 0.1] | 0.00")
    assert table.splitlines()[0] in (out / "table.md").read_text()
    with (out / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(r["trans_m"]) for r in rows] == [r["metrics"]["trans_m"]["mean"] for r in (fine, coarse)]
    html = (out / "report.html").read_text()
    page = Page(html)
    assert page.links == []
    assert "two steps &lt;on&gt; a tour" in html
    assert page.tags.count("image") == 2  # the maps
    assert page.tags.count("polyline") >= 6  # a path on each map, both paths, both error curves


def test_it_goes_on_where_it_stopped(place, monkeypatch):
    ablate(place)
    ran = []
    execute = job_module.execute

    def counted(job):
        ran.append(job)
        return execute(job)

    monkeypatch.setattr("knotwork.plugins.commands.ablate.engines.execute", counted)
    assert ablate(place)[0] == 0
    assert ran == []
    # Other metrics and names need no new run; another value runs alone; a damaged result runs again.
    renamed = ABLATION.replace("name: tour", "name: round").replace("- rot_deg", "- rot_sq_deg2")
    code, results = ablate(place, text=renamed)
    assert (code, ran) == (0, [])
    assert results["rows"][0]["names"]["data"] == "round"
    ablate(place, text=ABLATION.replace("[0.4]]", "[0.4], [0.3]]"))
    assert len(ran) == 1
    (place.folder / "out" / results["rows"][1]["runs"][0]["folder"] / "result.json").write_text('{"format"')
    ablate(place)
    assert len(ran) == 2
    # Another version of the product is another result.
    monkeypatch.setattr("knotwork.__version__", "9.9")
    ablate(place)
    assert len(ran) == 4


def test_equal_runs_are_run_once_and_seeds_are_averaged(place):
    text = ABLATION.replace("metrics:", "  seed: [1, 2]\naverage: [seed]\nmetrics:")
    code, results = ablate(place, text=text)
    assert code == 0
    assert len(results["rows"]) == 2
    row = results["rows"][0]
    assert len({run["digest"] for run in row["runs"]}) == 2
    assert row["metrics"]["trans_m"]["std"] == 0.0  # a log's replay has no random numbers
    twice = ABLATION.replace("[[0.2, 0.1], [0.4]]", "[[0.4]]").replace(
        "metrics:", "  copy: [{name: a}, {name: b}]\nmetrics:"
    )
    _, results = ablate(place, text=twice)
    assert len({run["digest"] for row in results["rows"] for run in row["runs"]}) == 1


def test_a_failing_run_is_recorded_and_the_others_go_on(place, capsys):
    text = ABLATION.replace("  nodes.map", "    - {name: gone, set: {vars.log: gone.clf}}\n  nodes.map")
    code, results = ablate(place, text=text)
    assert code == 1
    assert [row["state"] for row in results["rows"]] == ["done", "done", "failed", "failed"]
    error = results["rows"][2]["runs"][0]["error"]
    assert "small.yaml:4:31 via var log (" in error
    assert "a.yaml:11:36): node log: gone.clf: no such file" in error
    captured = capsys.readouterr()
    assert "3/4 failed: gone, [0.2, 0.1]: " in captured.err
    assert "Traceback" not in captured.err + captured.out
    assert "| failed |" in (place.folder / "out" / "table.md").read_text()
    html = (place.folder / "out" / "report.html").read_text()
    Page(html)
    assert "No run was finished." in html
    # It is tried again when its log has come.
    os.symlink(place.folder / "tour.clf", place.folder / "gone.clf")
    text = text.replace("gone.clf", '"${data}/gone.clf"')
    assert ablate(place, text=text)[0] == 0


def test_relations_of_another_log_leave_a_gap_with_a_note(place):
    (place.folder / "other.relations").write_text("1.0 2.0 0 0 0 0 0 0\n")
    _, results = ablate(place, text=ABLATION.replace("tour.relations", "other.relations"))
    assert results["rows"][0]["state"] == "done"
    assert results["rows"][0]["metrics"]["trans_m"] is None
    assert any("none of the 1 relations matches" in note for note in results["notes"])


def test_two_processes_give_what_one_gives(place):
    _, here = ablate(place)
    metrics = [{name: row["metrics"][name] for name in ("trans_m", "map_bytes")} for row in here["rows"]]
    _, there = ablate(place, "--again", jobs="2")
    assert [{name: row["metrics"][name] for name in ("trans_m", "map_bytes")} for row in there["rows"]] == metrics
    assert there["ran"] == "2 local processes"


def test_a_process_that_dies_is_one_failed_run():
    outcome = engines._in_a_process(_Fatal())
    assert outcome.error.startswith("its process ended without a result")


class _Fatal:
    """Ends the process that unpickles it."""

    def __reduce__(self):
        return os._exit, (9,)


def test_an_interrupt_leaves_finished_runs(place):
    text = ABLATION.replace("[[0.2, 0.1], [0.4]]", "[[0.4], [0.004]]").replace("small.yaml", "slow.yaml")
    (place.folder / "slow.yaml").write_text(BASE.replace("[0.2, 0.1]", "[0.4]"))
    arguments = ["ablate", place(text), "--out", str(place.folder / "out"), "--jobs", "1"]
    command = [sys.executable, "-m", "knotwork", *arguments, "--set", f"vars.data={place.folder}"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    done = place.folder / "out" / "runs"
    deadline = time.monotonic() + 120
    while process.poll() is None and time.monotonic() < deadline and not list(done.glob("*/result.json")):
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "interrupted: finished runs are kept" in err
    assert "Traceback" not in err
    results = json.loads((place.folder / "out" / "results.json").read_text())
    assert [row["state"] for row in results["rows"]] == ["done", "not run"]
    assert results["rows"][0]["metrics"]["trans_m"]["mean"] < 0.05
    assert "1 runs were not run" in out


def test_a_dask_cluster_gives_what_a_process_gives(place):
    distributed = pytest.importorskip("distributed", reason="needs knotwork[dask]")
    _, here = ablate(place)
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, protocol="tcp"
    )
    with cluster:
        code, there = ablate(place, "--again", "--scheduler", cluster.scheduler_address, jobs=None)
    assert code == 0
    assert [row["metrics"]["trans_m"] for row in there["rows"]] == [row["metrics"]["trans_m"] for row in here["rows"]]
    assert there["ran"].startswith("Dask at ")


def test_a_scheduler_that_is_not_there_is_said(place, capsys, monkeypatch):
    pytest.importorskip("distributed", reason="needs knotwork[dask]")
    monkeypatch.setattr("knotwork.plugins.commands.ablate.engines._CONNECT", 0.5)
    arguments = ["ablate", place(), "--out", str(place.folder / "out"), "--scheduler"]
    assert main([*arguments, "tcp://127.0.0.1:9"]) == 1
    assert "no scheduler answers at tcp://127.0.0.1:9" in capsys.readouterr().err
    assert main([*arguments, "nonsense://x"]) == 2
    assert "is no address" in capsys.readouterr().err


BROKEN = {
    "no axes": ("axes:", "axis:", ["a.yaml:5:1: axis", "unknown key of an ablation", "did you mean 'axes'?"]),
    "unknown base": ("small.yaml", "smal.yaml", ["a.yaml:3:7", "smal.yaml: does not exist", "'small.yaml'?"]),
    "unknown node": (
        "nodes.map.resolution",
        "nodes.mpa.resolution",
        ["a.yaml:11:", "unknown node 'mpa'", "did you mean 'map'?"],
    ),
    "unknown key": (
        "nodes.map.resolution",
        "nodes.map.resoluton",
        ["a.yaml:11:", "nodes.map.resoluton: unknown key of plugin 'spline-surface'", "did you mean 'resolution'?"],
    ),
    "unknown section": ("nodes.map.resolution", "node.map", ["a.yaml:11:3", "'node.map' is no config key", "'nodes'"]),
    "bad value": ("[0.4]]", "[far]]", ["a.yaml:11:39: nodes.map.resolution.0", "expected a number [m], got 'far'"]),
    "unknown plugin": ("vars.log:", "nodes.map.plugin: gird, vars.log:", ["a.yaml:8:", "there is no plugin 'gird'"]),
    "unknown key in set": ("vars.log:", "var.log:", ["a.yaml:8:", "'var.log' is no config key", "'vars'?"]),
    "unknown variable": ("vars.log:", "vars.lgo:", ["a.yaml:8:", "unknown variable 'lgo'", "did you mean 'log'?"]),
    "unknown reference": ("${data}/tour.clf", "${dat}/tour.clf", ["a.yaml:8:", "no variable 'dat'", "'data'?"]),
    "unknown field": ("relations:", "relation:", ["a.yaml:9:", "did you mean 'relations'?"]),
    "unnamed value": ("name: tour", "nam: tour", ["a.yaml:7:", "each of its values needs a `name:`"]),
    "unknown metric": ("trans_m", "tran_m", ["a.yaml:13:5: metrics.0", "there is no metric 'tran_m'", "'trans_m'?"]),
    "metric without key": ("key: statistics", "kye: statistics", ["a.yaml:19:", "metrics.6", "did you mean 'key'?"]),
    "empty axis": ("[[0.2, 0.1], [0.4]]", "[]", ["a.yaml:11:", "needs at least one value"]),
    "no list": ("[[0.2, 0.1], [0.4]]", "0.4", ["a.yaml:11:", "expected a list"]),
    "value twice": ("[0.4]]", "[0.2, 0.1]]", ["a.yaml:11:", "'[0.2, 0.1]' is there twice"]),
    "unknown average": ("metrics:", "average: [sed]\nmetrics:", ["a.yaml:12:11: average.0", "there is no axis 'sed'"]),
    "too many": ("[[0.2, 0.1], [0.4]]", str([[1 + i / 1e5] for i in range(10001)]), ["10001 runs, expected 10000"]),
    "bad yaml": ("base: small.yaml", "base: [small.yaml", ["a.yaml:4", "not valid YAML"]),
    "empty file": (ABLATION, "# nothing\n", ["a.yaml:1:1", "empty", "an ablation needs `ablation:`"]),
    "wrong kind": (ABLATION, BASE, ["a.yaml:1:1: pipeline", "unknown key of an ablation"]),
    "wiring": ("base: small.yaml", "base: small.yaml\nset: {nodes.prior: ~}", ["nodes.localizer.uses.prior", "prior"]),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_says_where_and_what_before_anything_runs(name, place, capsys):
    old, new, expected = BROKEN[name]
    assert old in ABLATION
    file = place(ABLATION.replace(old, new, 1))
    with pytest.raises(ConfigError) as raised:
        read_plan(file, Registry())
    for part in expected:
        assert part in str(raised.value)
    out = place.folder / "out"
    assert main(["ablate", file, "--out", str(out)]) == 2
    assert not out.exists()
    assert "Traceback" not in capsys.readouterr().err


def test_all_mistakes_are_said_at_once_and_each_once(place):
    text = ABLATION.replace("nodes.map.resolution", "nodes.map.resoluton").replace("vars.log:", "nodes.log.pth:")
    with pytest.raises(ConfigError) as raised:
        read_plan(place(text), Registry())
    found = [problem.path for problem in raised.value.problems]
    assert found.count("nodes.map.resoluton") == 2  # its two values
    assert found.count("nodes.log.pth") == 1  # in both runs


def test_check_lists_the_runs_and_runs_nothing(place, capsys):
    assert main(["ablate", place(), "--check", "--out", str(place.folder / "out")]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in listed] == ["to", "to", "ok:"]
    assert listed[-1] == "ok: steps: 2 runs of small.yaml"
    assert not (place.folder / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["--jobs", "-1"], "--jobs: expected 0 or more"), (["--jobs", "1", "--scheduler", "x"], "exclude each other")],
)
def test_wrong_arguments(place, capsys, arguments, said):
    assert main(["ablate", place(), *arguments]) == 2
    assert said in capsys.readouterr().err


def test_names_with_dots_are_found_in_results():
    data = {"nodes": {"localizer": {"n": 1}, "localizer.update": {"n": 2}}}
    assert look_up(data, "nodes.localizer.n") == 1
    assert look_up(data, "nodes.localizer.update.n") == 2
    assert look_up(data, "nodes.localizer.update.mean") is None


@pytest.mark.data
def test_the_shipped_table_runs_on_short_logs(data, tmp_path, monkeypatch):
    text = (CONFIGS / "ablations" / "maps.yaml").read_text()
    missing = set(re.findall(r"nodes\.map\.plugin: ([\w-]+)", text)) - set(Registry().names("map"))
    if missing:
        pytest.skip(f"the maps {', '.join(sorted(missing))} are not there")
    monkeypatch.setenv("KNOTWORK_DATA", str(data))
    arguments = ["ablate", "configs:ablations/maps", "--out", str(tmp_path), "--set", "nodes.log.limit=12"]
    assert main([*arguments, "--jobs", "0", "--json"]) == 0
    results = json.loads((tmp_path / "results.json").read_text())
    assert all(row["metrics"]["map_bytes"]["mean"] > 0 for row in results["rows"])
