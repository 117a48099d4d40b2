import ast
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

from knotwork.core.cli import new
from knotwork.core.cli.main import main
from knotwork.core.manifest import KINDS


def make(*words):
    return main(["new", "plugin", *words])


@pytest.mark.parametrize("kind", KINDS)
def test_files(tmp_path, capsys, kind):
    assert make("far-sight2", "--kind", kind, "--dir", str(tmp_path)) == 0
    folder = tmp_path / "far-sight2"
    files = {str(p.relative_to(folder)): p.read_text() for p in folder.rglob("*") if p.is_file()}
    package = "src/knotwork_far_sight2"
    expected = {
        "pyproject.toml",
        "README.md",
        f"{package}/__init__.py",
        f"{package}/{kind}.py",
        "tests/test_far_sight2.py",
    }
    assert expected <= set(files)
    assert ("pipeline.yaml" in files) == (kind != "command")
    assert sorted(capsys.readouterr().out.splitlines()[:-1]) == sorted(str(folder / name) for name in files)
    for name, text in files.items():
        assert not re.search(r"[Mm]y[-_]?[Pp]lugin|KIND|MODULE\b|HOW\b", text), name
        if name.endswith(".py"):
            ast.parse(text)
    project = tomllib.loads(files["pyproject.toml"])
    assert project["project"]["entry-points"]["knotwork.plugins"] == {"far-sight2": "knotwork_far_sight2:MANIFEST"}
    assert "class FarSight2(" in files[f"{package}/{kind}.py"]
    if kind != "command":
        assert "far-sight2" in {n["plugin"] for n in yaml.safe_load(files["pipeline.yaml"])["nodes"].values()}


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("", "cannot name a plugin"),
        ("Big", "cannot name a plugin"),
        ("a_b", "cannot name a plugin"),
        ("1st", "cannot name a plugin"),
        ("a--b", "cannot name a plugin"),
        ("a-", "cannot name a plugin"),
        ("../evil", "cannot name a plugin"),
        ("x" * 41, "cannot name a plugin"),
        ("naïve", "cannot name a plugin"),
        ("none", "a word of Python"),
        ("ekf", "there is a plugin 'ekf' already, of knotwork"),
    ],
)
def test_bad_names(tmp_path, capsys, name, says):
    assert make(name, "--kind", "sink", "--dir", str(tmp_path)) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.startswith("knotwork: NAME: ")
    assert error.count("\n") == 1
    assert not any(tmp_path.iterdir())


def test_a_command_that_exists(tmp_path, capsys):
    assert make("run", "--kind", "command", "--dir", str(tmp_path)) == 2
    assert "`knotwork run` exists already" in capsys.readouterr().err
    assert make("run", "--kind", "sink", "--dir", str(tmp_path)) == 0


def test_a_package_that_exists(tmp_path, capsys, monkeypatch):
    (tmp_path / "knotwork_taken").mkdir()
    (tmp_path / "knotwork_taken" / "__init__.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    assert make("taken", "--kind", "sink", "--dir", str(tmp_path)) == 2
    assert "there is a package knotwork_taken already" in capsys.readouterr().err


def test_a_folder_that_exists(tmp_path, capsys):
    (tmp_path / "mine").mkdir()
    assert make("mine", "--kind", "map", "--dir", str(tmp_path)) == 2
    assert capsys.readouterr().err == f"knotwork: {tmp_path / 'mine'}: exists already (choose another NAME or --dir)\n"
    assert not any((tmp_path / "mine").iterdir())


def test_a_folder_that_cannot_be_made(tmp_path, capsys):
    (tmp_path / "file").touch()
    assert make("mine", "--kind", "map", "--dir", str(tmp_path / "file")) == 2
    assert "cannot make the folder: Not a directory" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["mine"], ["mine", "--kind", "robot"], ["--kind", "map"]])
def test_wrong_arguments(words, capsys):
    assert make(*words) == 2
    assert "usage: knotwork new" in capsys.readouterr().err


def test_render():
    assert new.render("my-plugin my_plugin MyPlugin KIND", "a-b2", "map") == "a-b2 a_b2 AB2 map"


@pytest.mark.slow
def test_what_is_made_is_clean_by_our_own_rules(tmp_path):
    for kind in KINDS:
        new.write(f"new-{kind}", kind, tmp_path / kind)
    root = Path(__file__).parents[3]
    sources = [str(tmp_path / kind / "src") for kind in KINDS]
    path = {"MYPYPATH": os.pathsep.join([str(root / "src"), *sources])}
    packages = [word for kind in KINDS for word in ("-p", f"knotwork_new_{kind}")]
    ruff = [sys.executable, "-m", "ruff"]
    # Sorted imports depend on what a linter takes for one's own.
    rules = ["--select", "E,F,W,UP,B,C4,SIM,D,ANN,T20,BLE,NPY,PERF", "--ignore", "D105,D107,ANN401,PERF401"]
    style = ["--isolated", "--line-length", "120"]
    convention = ["--config", "lint.pydocstyle.convention='numpy'"]
    mypy = [sys.executable, "-m", "mypy", "--strict", "--ignore-missing-imports", "--follow-imports=silent"]
    for words in (
        [*ruff, "check", *style, *rules, *convention, "--no-cache", *sources],
        [*ruff, "format", *style, "--check", "--no-cache", *sources],
        [*mypy, "--cache-dir", str(tmp_path / "cache"), *packages],
    ):
        done = subprocess.run(words, cwd=tmp_path, env=os.environ | path, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
