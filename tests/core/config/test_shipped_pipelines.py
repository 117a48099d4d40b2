"""Every pipeline that comes with the package is whole: it loads, and its wires fit."""

from importlib.resources import files

import pytest

from knotwork.core.cli.main import main

NAMES = sorted(entry.name for entry in (files("knotwork") / "configs").iterdir() if entry.name.endswith(".yaml"))


@pytest.mark.parametrize("name", NAMES)
def test_it_validates(name, capsys):
    assert main(["validate", f"configs:{name}"]) == 0, capsys.readouterr().err


def test_a_goal_of_one_feature_is_refused(tmp_path, capsys):
    text = (files("knotwork") / "configs" / "turtlebot3-depth.yaml").read_text()
    file = tmp_path / "one.yaml"
    file.write_text(text.replace("needed: 4", 'needed: 4, goal: {"0": [0.1, 0.0]}'))
    assert main(["validate", str(file)]) == 2
    error = capsys.readouterr().err
    assert "nodes.drive" in error
    assert "two features" in error
