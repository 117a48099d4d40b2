"""The example of docs/writing-a-plugin.md is a plugin: installed, described, run and tested as it stands there."""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "writing-a-plugin.md"
FILE = re.compile(r"^`([\w./]+)`\n\n```\w+\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SESSION = re.compile(r"^```console\n\$ (.*?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """The folder of the example, and the environment variables under which it is installed."""
    folder = tmp_path_factory.mktemp("standing")
    for name, text in FILE.findall(PAGE.read_text()):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    info = folder / "src" / f"knotwork_standing-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    points = project["entry-points"]["knotwork.plugins"]
    (info / "entry_points.txt").write_text("[knotwork.plugins]\n" + "".join(f"{k} = {v}\n" for k, v in points.items()))
    return folder, os.environ | {"PYTHONPATH": str(folder / "src")}


def call(example, *words):
    folder, environment = example
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def knotwork(example, *words):
    program = f"import sys; from knotwork.core.cli.main import main; sys.exit(main({list(words)!r}))"
    return call(example, sys.executable, "-c", program)


def test_all_files_are_there(example):
    folder, _ = example
    source = {p.relative_to(folder).as_posix() for p in folder.rglob("*.py")}
    assert source == {f"src/knotwork_standing/{n}.py" for n in ("__init__", "messages", "observer")} | {
        "tests/test_standing.py"
    }


@pytest.mark.parametrize(("command", "shown"), SESSION.findall(PAGE.read_text()))
def test_shown_output(example, command, shown):
    done = knotwork(example, *shlex.split(command)[1:])
    assert done.stdout == shown, done.stderr


def test_it_passes_its_tests(example):
    done = call(example, sys.executable, "-m", "pytest", "-q", "-W", "error", "-p", "no:cacheprovider", "tests")
    assert done.returncode == 0, done.stdout
    assert "test_it_stops" not in done.stdout  # no failure is named


def test_its_pipeline_runs(example):
    done = knotwork(example, "run", "pipeline.yaml", "--out", "out")
    assert done.returncode == 0, done.stderr
    folder, _ = example
    code = (
        "from pathlib import Path; from knotwork.core.log.reader import Log\n"
        "from knotwork.core.registry import Registry\n"
        "Registry()\n"
        "print([m.still for _, m in Log(Path('out/log.mcap')).messages(types={'standing'})])"
    )
    assert call(example, sys.executable, "-c", code).stdout == "[False, True]\n"
    assert (folder / "out" / "log.mcap").is_file()


def test_what_the_page_names_exists():
    text = PAGE.read_text()
    import knotwork.core.conformance as kit

    for name in re.findall(r"`(\w+Suite|Room|RoomMap|FixedPrior)`", text):
        assert hasattr(kit, name)
    rows = re.search(r"\| suite \|.*?\n\n", text, re.DOTALL)[0]
    for line in rows.strip().splitlines()[2:]:
        suites, knobs = line.strip("| ").split(" | ")
        for suite in re.findall(r"`(\w+)`", suites) or ["DriverSuite"]:
            for knob in re.findall(r"`(\w+)(?:\([\w, ]*\))?`", knobs):
                assert hasattr(getattr(kit, suite), knob) or knob == "plugin", (suite, knob)
