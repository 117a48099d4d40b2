import argparse
import json

import pytest

from knotwork.core.errors import InputError
from knotwork.core.evaluation.tum import write_tum
from knotwork.plugins.commands.evaluate import MANIFEST
from knotwork.plugins.commands.evaluate.command import EvaluateCommand


@pytest.fixture
def evaluate(capsys):
    def run(*arguments):
        command = EvaluateCommand()
        parser = argparse.ArgumentParser()
        command.arguments(parser)
        assert command.run(parser.parse_args([str(argument) for argument in arguments])) == 0
        return capsys.readouterr().out

    return run


@pytest.fixture
def files(tmp_path):
    write_tum(tmp_path / "est.tum", [10**9, 2 * 10**9, 90 * 10**9], [(0, 0, 0), (1.1, 0, 0), (5, 0, 0)])
    write_tum(tmp_path / "ref.tum", [10**9, 2 * 10**9, 90 * 10**9], [(0, 0, 0), (1, 0, 0), (5, 0, 0)])
    (tmp_path / "r").write_text("1.0 2.0 1 0 0 0 0 0\n1.0 90.0 5 0 0 0 0 0.5\n1.0 40.0 5 0 0 0 0 0.5\n")
    (tmp_path / "late").write_text("1e6 2e6 1 0 0 0 0 0\n")
    return tmp_path


def test_manifest():
    assert (MANIFEST.name, MANIFEST.kind) == ("evaluate", "command")


def test_relations_as_json(evaluate, files):
    score = json.loads(evaluate("relations", files / "est.tum", files / "r", "--json"))
    assert (score["used"], score["missed"]) == (2, 1)
    assert score["trans_abs_mean_m"] == pytest.approx(0.05)
    assert score["short"]["trans_abs_mean_m"] == pytest.approx(0.1)
    assert score["long"]["rot_abs_mean_deg"] == pytest.approx(28.6479, abs=1e-3)
    wide = json.loads(evaluate("relations", files / "est.tum", files / "r", "--json", "--tolerance", "60"))
    assert wide["missed"] == 0


def test_relations_as_a_table(evaluate, files):
    out = evaluate("relations", files / "est.tum", files / "r").splitlines()
    assert [line.split("  ")[0] for line in out[1:4]] == ["all", "|t2 - t1| < 10 s", "|t2 - t1| > 60 s"]
    assert "0.05 +- 0.05" in out[1]


def test_an_empty_subset_is_a_dash_and_a_null(evaluate, files):
    (files / "one").write_text("1.0 2.0 1 0 0 0 0 0\n")
    assert evaluate("relations", files / "est.tum", files / "one").splitlines()[3].split()[-1] == "-"
    assert (
        json.loads(evaluate("relations", files / "est.tum", files / "one", "--json"))["long"]["rot_abs_mean_deg"]
        is None
    )


def test_trajectory(evaluate, files):
    score = json.loads(evaluate("trajectory", files / "est.tum", files / "ref.tum", "--json"))
    assert score["ate"]["trans_max_m"] == pytest.approx(0.1)
    assert score["align"] == "none"
    out = evaluate("trajectory", files / "est.tum", files / "ref.tum", "--align", "se2")
    assert "absolute [m]" in out
    assert "3 poses matched, 0 missed, alignment: se2" in out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("relations", "no.tum", "r"), "no.tum: no such file"),
        (("relations", "est.tum", "late"), "none of the 1 relations"),
        (("trajectory", "r", "ref.tum"), "quaternion"),
        (("trajectory", "est.tum", "."), "is a directory"),
        (("relations", "est.tum", "r", "--tolerance", "-1"), "--tolerance: expected"),
        (("relations", "est.tum", "r", "--tolerance", "nan"), "--tolerance: expected"),
    ],
)
def test_mistakes_are_input_errors_of_one_line(evaluate, files, monkeypatch, arguments, says):
    monkeypatch.chdir(files)
    with pytest.raises(InputError, match=says) as caught:
        evaluate(*arguments)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2
