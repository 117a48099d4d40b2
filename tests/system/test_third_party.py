"""Third-party packages in an environment of their own: made, built, installed, listed, run, read back, tested."""

import json
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from knotwork.core.cli import new
from knotwork.core.manifest import KINDS

ROOT = Path(__file__).parents[2]
SPARE = (
    "knotwork.egg-info",
    ".git",
    ".venv",
    "build",
    "dist",
    "runs",
    "tests",
    "bench",
    "docs",
    "__pycache__",
    ".*_cache",
)

MANIFEST = "from knotwork.core.manifest import Manifest\nMANIFEST = Manifest({})\n"
BROKEN = {
    "raises": "raise RuntimeError('I am not finished')\n",
    "needs": "import a_library_that_is_not_there\n",
    "old": MANIFEST.format("'old', 'sink', 's', 'x:Y', contract=0"),
    "half": MANIFEST.format("'half', 'sink', 's', 'x:Y', requires=('a_library_that_is_not_there',)"),
    "ekf": MANIFEST.format("'ekf', 'observer', 'mine is better', 'x:Y'"),
    "late": MANIFEST.format("'late', 'sink', 'breaks when it is used', 'knotwork_no_such_module:Y'"),
}

PIPELINE = """pipeline: outside
nodes:
  robot: {plugin: ext-driver, radius: 0.5, speed: 0.5, duration: 4}
  driven: {plugin: ext-observer}
  table: {plugin: ext-sink}
  recorder: {plugin: mcap}
"""

READ = """
import json, sys
from pathlib import Path
from knotwork.core.log.reader import Log
from knotwork.core.registry import Registry
Registry()
found = list(Log(Path(sys.argv[1])).messages(streams={"driven.distance"}))
print(json.dumps([[type(m).__module__, m.metres, m.stamp] for _, m in found]))
"""


def call(*words, cwd=None, code=0):
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, cwd=cwd, timeout=500)
    assert done.returncode == code, f"{words}\n{done.stdout}\n{done.stderr}"
    return done


class Environment:
    """A fresh environment; what Knotwork depends on is seen where it is installed already, Knotwork is not."""

    def __init__(self, folder):
        self.folder = folder
        call(sys.executable, "-m", "venv", "--without-pip", folder)
        site = next((folder / "lib").glob("python3*")) / "site-packages"
        here = dict.fromkeys([sysconfig.get_path("purelib"), sysconfig.get_path("platlib")])
        (site / "dependencies.pth").write_text("\n".join(here) + "\n")

    def install(self, *sources, wheels):
        pip = (sys.executable, "-m", "pip", "--disable-pip-version-check")
        call(*pip, "wheel", "-q", "--no-deps", "--no-index", "--no-build-isolation", "-w", wheels, *sources)
        files = sorted(wheels.glob("*.whl"))
        call(*pip, "--python", self.python, "install", "-q", "--no-deps", "--no-index", *files)

    @property
    def python(self):
        return self.folder / "bin" / "python"

    def knotwork(self, *words, cwd, code=0):
        return call(self.folder / "bin" / "knotwork", *words, cwd=cwd, code=code)


@pytest.fixture(scope="module")
def outside(tmp_path_factory):
    """An environment with Knotwork from a wheel, a made plugin of each kind and the broken ones."""
    folder = tmp_path_factory.mktemp("outside")
    shutil.copytree(ROOT, folder / "checkout", symlinks=True, ignore=shutil.ignore_patterns(*SPARE))
    sources = [folder / "checkout"]
    for kind in KINDS:
        new.write(f"ext-{kind}", kind, folder / f"ext-{kind}")
        sources.append(folder / f"ext-{kind}")
    for name, text in BROKEN.items():
        source = folder / f"broken-{name}"
        source.mkdir()
        (source / f"broken_{name}.py").write_text(text)
        (source / "pyproject.toml").write_text(
            '[build-system]\nrequires = ["setuptools"]\nbuild-backend = "setuptools.build_meta"\n'
            f'[project]\nname = "broken-{name}"\nversion = "0.3"\n'
            f'[project.entry-points."knotwork.plugins"]\n{name} = "broken_{name}:MANIFEST"\n'
            f'[tool.setuptools]\npy-modules = ["broken_{name}"]\n'
        )
        sources.append(source)
    environment = Environment(folder / "venv")
    environment.install(*sources, wheels=folder / "wheels")
    return environment, folder


pytestmark = pytest.mark.slow


def test_knotwork_is_the_one_that_was_installed(outside):
    environment, folder = outside
    where = call(environment.python, "-c", "import knotwork; print(knotwork.__file__)", cwd=folder).stdout
    assert str(environment.folder) in where


def test_listed(outside):
    environment, folder = outside
    rows = {r["name"]: r for r in json.loads(environment.knotwork("plugins", "--json", cwd=folder).stdout)}
    for kind in KINDS:
        row = rows[f"ext-{kind}"]
        assert (row["kind"], row["state"]) == (kind, "ok"), row
        assert row["distribution"] == f"knotwork-ext-{kind} 0.1.0"
    described = environment.knotwork("plugins", "ext-observer", cwd=folder).stdout
    assert "threshold: number [m], default 0.001" in described
    assert "gives distance: my" not in described


def test_broken_ones_are_lines_with_their_cause(outside):
    environment, folder = outside
    done = environment.knotwork("plugins", cwd=folder)
    assert done.stderr == ""
    lines = {line.split()[0]: line for line in done.stdout.splitlines() if line.startswith("  ")}
    assert "[broken: RuntimeError: I am not finished]" in lines["raises"]
    assert "[broken: ModuleNotFoundError: No module named 'a_library_that_is_not_there']" in lines["needs"]
    assert "[broken: written for contract 0, this is contract 1: update the plugin]" in lines["old"]
    assert "[missing: needs a_library_that_is_not_there: pip install a_library_that_is_not_there]" in lines["half"]
    clash = next(line for line in done.stdout.splitlines() if "mine is better" in line)
    assert "[broken: the name 'ekf' is taken by knotwork " in clash
    assert "(broken-ekf 0.3)" in clash
    assert all(name in lines["raises"] + done.stdout for name in BROKEN)


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        ("raises", "I am not finished"),
        ("old", "written for contract 0"),
        ("half", "needs a_library"),
        ("late", "cannot be imported"),
    ],
)
def test_a_broken_one_is_fatal_only_to_a_pipeline_that_names_it(outside, tmp_path, name, cause):
    environment, _ = outside
    (tmp_path / "p.yaml").write_text(
        f"pipeline: p\nnodes:\n  robot: {{plugin: ext-driver}}\n  bad: {{plugin: {name}}}\n"
    )
    done = environment.knotwork("run", "p.yaml", "--out", "out", cwd=tmp_path, code=2)
    assert cause in done.stderr
    assert "Traceback" not in done.stderr
    (tmp_path / "p.yaml").write_text("pipeline: p\nnodes:\n  robot: {plugin: ext-driver}\n  ok: {plugin: ext-sink}\n")
    assert environment.knotwork("validate", "p.yaml", cwd=tmp_path).stdout.startswith("ok: p: 2 nodes")


def test_run_logged_and_read_back(outside, tmp_path):
    environment, _ = outside
    (tmp_path / "p.yaml").write_text(PIPELINE)
    environment.knotwork("run", "p.yaml", "--out", "out", cwd=tmp_path)
    read = call(environment.python, "-c", READ, "out/log.mcap", cwd=tmp_path).stdout
    messages = json.loads(read)
    assert len(messages) == 81  # 4 s at 20 Hz, both ends
    assert {module for module, _, _ in messages} == {"knotwork_ext_observer.messages"}
    # 2 m along a circle of radius 0.5 m, measured by chords of 25 mm
    assert messages[-1][1] == pytest.approx(2.0, abs=0.001)
    assert messages[-1][2] == 4_000_000_000
    assert len((tmp_path / "out" / "messages.csv").read_text().splitlines()) > 2 * 81


def test_the_command(outside, tmp_path):
    environment, _ = outside
    assert "ext-command" in environment.knotwork("--help", cwd=tmp_path).stdout
    (tmp_path / "t.tum").write_text("0 0 0 0\n1 3 4 0\n")
    assert environment.knotwork("ext-command", "t.tum", cwd=tmp_path).stdout == "5.000 m, 2 poses\n"


def test_the_templates_are_in_the_wheel(outside, tmp_path):
    environment, _ = outside
    environment.knotwork("new", "plugin", "another", "--kind", "map", cwd=tmp_path)
    assert (tmp_path / "another" / "src" / "knotwork_another" / "map.py").is_file()
    environment.knotwork("new", "plugin", "ext-map", "--kind", "map", cwd=tmp_path, code=2)


def test_their_own_tests_pass(outside):
    environment, folder = outside
    tests = [f"ext-{kind}/tests" for kind in KINDS]
    done = call(environment.python, "-m", "pytest", "-q", "-W", "error", "-p", "no:cacheprovider", *tests, cwd=folder)
    assert int(re.search(r"(\d+) passed", done.stdout)[1]) > 80
    assert "failed" not in done.stdout


@pytest.mark.parametrize("kind", [k for k in KINDS if k != "command"])
def test_its_pipeline_runs(outside, kind, tmp_path):
    environment, folder = outside
    pipeline = folder / f"ext-{kind}" / "pipeline.yaml"
    done = environment.knotwork("run", pipeline, "--out", "out", "--json", cwd=tmp_path)
    counted = json.loads(done.stdout)["statistics"]["nodes"]
    busy = {
        "driver": "robot",
        "map": "localizer",
        "localizer": "localizer",
        "observer": "driven",
        "policy": "drive",
        "sink": "table",
    }
    assert counted[busy[kind]]["n"] > 20
