import subprocess
import sys
from pathlib import Path

from knotwork.core.emulator.folder import LinkFolder

LEAVE = (
    "import os, sys, pathlib; from knotwork.core.emulator.folder import LinkFolder;"
    "f = LinkFolder(pathlib.Path(sys.argv[1])); (f.path / 'lidar').symlink_to('/dev/null');"
    "os.kill(os.getpid(), 9)"
)


def test_folders_of_the_living_stay_and_those_of_the_killed_go(tmp_path: Path) -> None:
    first = LinkFolder(tmp_path)
    killed = subprocess.run([sys.executable, "-c", LEAVE, str(tmp_path)], check=False)
    assert killed.returncode == -9
    (left,) = set(tmp_path.iterdir()) - {first.path}
    assert (left / "lidar").is_symlink()
    second = LinkFolder(tmp_path)
    assert set(tmp_path.iterdir()) == {first.path, second.path}
    second.remove()
    second.remove()
    assert set(tmp_path.iterdir()) == {first.path}
    first.remove()
    assert not list(tmp_path.iterdir())


def test_what_others_keep_there_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "knotwork-mine").mkdir()
    (tmp_path / "knotwork-emulator-file").touch()
    (tmp_path / "target").mkdir()
    (tmp_path / "knotwork-emulator-link").symlink_to(tmp_path / "target")
    LinkFolder(tmp_path).remove()
    assert {p.name for p in tmp_path.iterdir()} == {
        "knotwork-mine", "knotwork-emulator-file", "target", "knotwork-emulator-link",
    }  # fmt: skip
