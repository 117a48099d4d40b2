"""A short piece of the experiment: curve SLAM in simulation, against the truth."""

import json

from knotwork.core.cli.main import main


def test_along_a_wall_and_in_a_turn_the_curve_map_keeps_the_pose(tmp_path, capsys):
    assert main(["experiment", "curve-slam", "--knots", "pyramid", "--duration", "20", "--out", str(tmp_path)]) == 0
    table = capsys.readouterr().out
    result = json.loads((tmp_path / "results.json").read_text())["pyramid"]
    walls, turn = result["walls"], result["turn"]
    assert walls["path_m"] > 3.0
    assert walls["lost_scans"] == turn["lost_scans"] == 0
    assert walls["translation_rms_m"] < 0.02
    assert walls["end_rotation_deg"] < 0.5
    assert turn["end_rotation_deg"] < 1.0
    assert turn["end_translation_m"] < 0.03
    assert walls["map_nbytes"] == walls["map_bytes"] == 9 * walls["control_points"] + 12 * walls["curves"]
    assert f"{walls['path_m']:.1f} m" in table
    assert (tmp_path / "curve-slam.png").stat().st_size > 10_000


def test_a_nonsense_duration_is_refused(tmp_path, capsys):
    assert main(["experiment", "curve-slam", "--duration", "0", "--out", str(tmp_path)]) != 0
    assert "--duration" in capsys.readouterr().err
