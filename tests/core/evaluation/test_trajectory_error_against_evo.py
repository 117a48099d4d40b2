import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core.errors import InputError
from knotwork.core.evaluation.se2 import compose
from knotwork.core.evaluation.trajectory_error import align_se2, score_trajectory
from knotwork.core.evaluation.tum import StampedPoses, read_tum, write_tum

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from evo.core import metrics
    from evo.tools import file_interface

WHAT = {"rmse": "rmse", "mean": "mean", "median": "median", "std": "std", "min": "min", "max": "max"}


@pytest.fixture
def files(tmp_path):
    rng = np.random.default_rng(4)
    n = 300
    stamps = 1_000_000_000 * 10**9 + np.arange(n) * 200_000_000
    yaw = np.cumsum(rng.normal(0, 0.1, n))
    steps = np.stack((np.cos(yaw), np.sin(yaw)), axis=1) * rng.uniform(0, 0.3, (n, 1))
    reference = np.column_stack((np.cumsum(steps, axis=0), yaw))
    drift = np.cumsum(rng.normal(0, 0.01, (n, 3)), axis=0)
    estimate = compose(np.array((3.0, -2.0, 1.1)), reference + drift)
    write_tum(tmp_path / "est.tum", stamps, estimate)
    write_tum(tmp_path / "ref.tum", stamps, reference)
    return tmp_path / "est.tum", tmp_path / "ref.tum"


def check(part, metric, pair, unit):
    metric.process_data(pair)
    for what, name in WHAT.items():
        assert part[f"{unit[0]}_{what}_{unit[1]}"] == pytest.approx(
            metric.get_statistic(metrics.StatisticsType[name]), abs=2e-6
        )


RELATION = {
    ("trans", "m"): metrics.PoseRelation.translation_part,
    ("rot", "deg"): metrics.PoseRelation.rotation_angle_deg,
}


@pytest.mark.parametrize("unit", RELATION, ids=lambda unit: unit[0])
@pytest.mark.parametrize("align", ["none", "se2"])
def test_ate_and_rpe_are_those_of_evo(files, align, unit):
    score = score_trajectory(read_tum(files[0]), read_tum(files[1]), align)
    estimate, reference = (file_interface.read_tum_trajectory_file(str(path)) for path in files)
    if align == "se2":
        estimate.align(reference)
    pair = (reference, estimate)
    assert (score["matched"], score["missed"], score["align"]) == (300, 0, align)
    check(score["ate"], metrics.APE(RELATION[unit]), pair, unit)
    check(score["rpe_frame"], metrics.RPE(RELATION[unit], 1, metrics.Unit.frames), pair, unit)
    metre = metrics.RPE(RELATION[unit], 1.0, metrics.Unit.meters)
    check(score["rpe_metre"], metre, pair, unit)
    assert score["rpe_metre"]["pairs"] == len(metre.error)
    assert score["rpe_frame"]["pairs"] == 299


@given(st.floats(-100, 100), st.floats(-100, 100), st.floats(-3.1, 3.1), st.integers(0, 99))
def test_alignment_finds_a_known_transform(x, y, yaw, seed):
    poses = np.random.default_rng(seed).normal(0, 5, (10, 3))
    moved = compose(np.array((x, y, yaw)), poses)
    assert np.allclose(align_se2(poses, moved), (x, y, yaw), atol=1e-9)


def test_stamps_are_matched_and_the_rest_is_missed():
    poses = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    reference = StampedPoses(np.array([0, 10**9, 2 * 10**9]), poses)
    estimate = StampedPoses(np.array([2 * 10**9 + 9_000_000, 5 * 10**9, 0]), poses[[2, 1, 0]] + (0, 0.1, 0))
    score = score_trajectory(estimate, reference)
    assert (score["matched"], score["missed"]) == (2, 1)
    assert score["ate"]["trans_rmse_m"] == pytest.approx(0.1)
    assert score["rpe_frame"]["trans_max_m"] == pytest.approx(0.0)
    alone = score_trajectory(StampedPoses(np.array([0]), poses[:1]), reference, "se2")
    assert alone["rpe_frame"] == alone["rpe_metre"]
    assert alone["rpe_frame"]["trans_rmse_m"] is None
    with pytest.raises(InputError, match="no estimated pose"):
        score_trajectory(StampedPoses(np.array([10**12]), poses[:1]), reference)
