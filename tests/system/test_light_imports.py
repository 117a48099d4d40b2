"""What a Raspberry Pi should not pay for."""

import subprocess
import sys

import pytest

PROGRAM = """
import sys
from knotwork.core.cli.main import main
code = main({argv!r})
heavy = [m for m in {forbidden!r} if m in sys.modules]
assert not heavy, heavy
assert not [m for m in ("core", "plugins", "configs") if m in sys.modules]
sys.exit(code)
"""


def run(argv, forbidden):
    program = PROGRAM.format(argv=argv, forbidden=forbidden)
    return subprocess.run([sys.executable, "-P", "-c", program], capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize(
    "argv",
    [
        ["--help"],
        ["--version"],
        ["plugins"],
        ["plugins", "spline-surface"],
        ["validate", "configs:radish.yaml"],
        ["graph", "configs:radish.yaml"],
        ["config", "show", "configs:radish.yaml", "--origin"],
        ["schema"],
        ["run", "--help"],
    ],
    ids=" ".join,
)
def test_commands_that_only_read_manifests_import_no_numpy(argv):
    done = run(argv, ["numpy", "scipy", "numba"])
    assert done.returncode == 0, done.stderr


def test_a_pipeline_of_drivers_and_sinks_imports_neither_scipy_nor_numba(tmp_path):
    log = tmp_path / "tiny.clf"
    beams = " ".join(["1.00"] * 180)
    log.write_text("".join(f"FLASER 180 {beams} 0 0 0 0 0 0 {i}.5 host {i}.5\n" for i in range(5)))
    file = tmp_path / "record.yaml"
    file.write_text(
        "pipeline: record\nnodes:\n"
        f"  log: {{plugin: carmen, path: {log}}}\n"
        "  recorder: {plugin: mcap}\n  summary: {plugin: summary}\n"
    )
    done = run(["run", str(file), "--out", str(tmp_path / "out")], ["scipy", "numba"])
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "log.mcap").stat().st_size > 0
