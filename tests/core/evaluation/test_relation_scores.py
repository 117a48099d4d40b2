import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core.errors import InputError
from knotwork.core.evaluation.relations import Relations, read_relations, score_relations
from knotwork.core.evaluation.se2 import compose, relative
from knotwork.core.evaluation.tum import StampedPoses

SECOND = 10**9
POSES = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-math.pi, math.pi))
KEYS = {
    f"{part}_{what}_{spread}_{unit}{power}"
    for part, unit in (("trans", "m"), ("rot", "deg"))
    for what, power in (("abs", ""), ("sq", "2"))
    for spread in ("mean", "std")
} | {"used", "missed"}


def matrix(pose):
    x, y, yaw = pose
    return np.array([[math.cos(yaw), -math.sin(yaw), x], [math.sin(yaw), math.cos(yaw), y], [0, 0, 1]])


@given(POSES, POSES)
def test_compose_and_relative_are_products_of_matrices(a, b):
    assert np.allclose(matrix(compose(np.array(a), np.array(b))), matrix(a) @ matrix(b), atol=1e-9)
    assert np.allclose(matrix(relative(np.array(a), np.array(b))), np.linalg.inv(matrix(a)) @ matrix(b), atol=1e-9)


@given(POSES, POSES, POSES)
def test_the_error_of_one_relation_is_measured_inverse_times_estimated(a, b, measured):
    trajectory = StampedPoses(np.array([0, SECOND]), np.array([a, b]))
    score = score_relations(trajectory, Relations(np.array([0]), np.array([SECOND]), np.array([measured])))
    error = np.linalg.inv(matrix(measured)) @ np.linalg.inv(matrix(a)) @ matrix(b)
    trans = math.hypot(error[0, 2], error[1, 2])
    rot = abs(math.degrees(math.atan2(error[1, 0], error[0, 0])))
    assert score["trans_abs_mean_m"] == pytest.approx(trans, abs=1e-9)
    assert score["trans_sq_mean_m2"] == pytest.approx(trans**2, abs=1e-7)
    assert score["rot_abs_mean_deg"] == pytest.approx(rot, abs=1e-6)
    assert score["rot_sq_mean_deg2"] == pytest.approx(rot**2, abs=1e-4)
    assert score["trans_abs_std_m"] == score["rot_abs_std_deg"] == 0.0


def line(times):
    """Relations of 1 m ahead on a straight line, the trajectory off by 1, 2, 3 ... cm."""
    stamps = np.array([t * SECOND for pair in times for t in pair])
    poses = np.zeros((stamps.size, 3))
    poses[1::2, 0] = 1.0 + 0.01 * np.arange(1, len(times) + 1)
    relations = Relations(stamps[::2], stamps[1::2], np.tile((1.0, 0.0, 0.0), (len(times), 1)))
    return StampedPoses(stamps, poses), relations


def test_subsets_counts_and_population_deviations():
    # 9, 10, 60, 61 and -70 s: short is strictly below 10 s, long strictly above 60 s, either way round.
    trajectory, relations = line([(0, 9), (100, 110), (200, 260), (300, 361), (500, 430)])
    score = score_relations(trajectory, relations)
    assert set(score) == KEYS | {"short", "long"}
    assert set(score["short"]) == set(score["long"]) == KEYS
    assert (score["used"], score["missed"]) == (5, 0)
    assert score["trans_abs_mean_m"] == pytest.approx(0.03)
    assert score["trans_abs_std_m"] == pytest.approx(math.sqrt(2) * 0.01)
    assert score["trans_sq_mean_m2"] == pytest.approx(11e-4)
    assert (score["short"]["used"], score["short"]["trans_abs_mean_m"]) == (1, pytest.approx(0.01))
    assert (score["long"]["used"], score["long"]["trans_abs_mean_m"]) == (2, pytest.approx(0.045))


def test_relations_without_a_pose_are_missed():
    trajectory, relations = line([(0, 5), (100, 105), (200, 300)])
    late = Relations(relations.first, relations.second + np.array([100_000, 100_001, 100_001]), relations.poses)
    score = score_relations(trajectory, late)
    assert (score["used"], score["missed"]) == (1, 2)
    assert (score["short"]["used"], score["short"]["missed"]) == (1, 1)
    assert (score["long"]["used"], score["long"]["missed"]) == (0, 1)
    assert score["long"]["trans_abs_mean_m"] is None
    assert score_relations(trajectory, late, tolerance=1e-3)["used"] == 3


def test_the_nearest_pose_counts_not_the_first_within_reach():
    trajectory = StampedPoses(np.array([0, SECOND - 60_000, SECOND, SECOND + 60_000]), np.diag([0.0, 9, 1, 9])[:, 1:])
    trajectory.poses[2] = (1.0, 0.0, 0.0)
    score = score_relations(trajectory, Relations(np.array([0]), np.array([SECOND]), np.array([[1.0, 0, 0]])))
    assert score["trans_abs_mean_m"] == 0.0


def test_nothing_in_common_is_the_users_mistake():
    trajectory, relations = line([(0, 5)])
    shifted = Relations(relations.first + 50 * SECOND, relations.second + 50 * SECOND, relations.poses)
    with pytest.raises(InputError, match="none of the 1 relations"):
        score_relations(trajectory, shifted)


def test_relations_file(tmp_path):
    path = tmp_path / "r.relations"
    path.write_text("976052905.167303 976052911.885496 -0.05 -0.12 0 0 0 -1.68\n")
    relations = read_relations(path)
    assert relations.first.tolist() == [976052905167303000]
    assert relations.second.tolist() == [976052911885496000]
    assert relations.poses.tolist() == [[-0.05, -0.12, -1.68]]
    path.write_text("1 2 3\n")
    with pytest.raises(InputError, match="t1 t2 x y z roll pitch yaw"):
        read_relations(path)
