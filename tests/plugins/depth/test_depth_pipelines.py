"""Pipelines give what the compiled loops of the experiments give: the same kernels in the same order."""

import numpy as np
import pytest

from knotwork.core.camera import project
from knotwork.plugins.commands.experiment import depth_robot, servo_runs
from knotwork.plugins.commands.experiment.scenarios import SETTINGS, scenario
from knotwork.plugins.commands.experiment.servo_runs import MODES
from knotwork.plugins.commands.experiment.single_runs import single

OBSERVER = {"ekf": {"plugin": "depth-ekf"}}


def servo_nodes(scene, mode, gain, solver="compiled", duration=15.0):
    goal = {str(i): point for i, point in enumerate(scene.goal.tolist())}
    policy = {"ekf": "passive", "ekf active+": "active+"}.get(mode, mode)
    guess = {str(i): float(c) for i, c in enumerate(scene.guess)}
    observer = {"plugin": "depth-ekf" if "ekf" in mode else "depth-fixed-gain"}
    return {
        "camera": {
            "plugin": "sim-camera", "points": scene.points.tolist(), "duration": duration,
            "inputs": {"command": "servo.twist"},
        },
        "depths": {**observer, "guess": guess, "inputs": {"twist": "camera.applied"}},
        "servo": {"plugin": "visual-servo", "mode": policy, "gain": gain, "goal": goal, "solver": solver},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("mode", "first"), [("ideal", 0), ("passive", 10), ("active", 20), ("active+", 30), ("ekf", 40)]
)
def test_fifty_scenarios_run_alike_as_pipelines_and_in_the_batch(pipeline, mode, first):
    for index in range(first, first + 10):
        setting = SETTINGS["AB"[index % 2]]
        scene = scenario(setting, 4 + index % 6, 3, index)
        batch = servo_runs.trace(scene, mode, setting.gain, "none", 0)
        result, streams = pipeline(servo_nodes(scene, mode, setting.gain))
        assert result.exit_code == 0
        truth = streams["camera.truth"]
        assert len(truth) == 301
        errors = [np.linalg.norm(message.points - scene.goal) for message in truth]
        np.testing.assert_allclose(errors, batch.errors, atol=1e-6)
        position = [message.position for message in streams["camera.camera"]]
        np.testing.assert_allclose(position, batch.path[:, :3], atol=1e-6)
        if mode != "ideal":
            wrong = [d.chi - t.chi for d, t in zip(streams["depths.depths"], truth, strict=True)]
            np.testing.assert_allclose(wrong, batch.chi_error, atol=1e-6)
        phases = [state.phase for state in streams["servo.state"]]
        np.testing.assert_array_equal(phases, batch.phases)


@pytest.mark.parametrize("name", ["clarabel", "osqp", "daqp"])
def test_a_whole_run_is_the_same_with_every_solver(pipeline, name):
    pytest.importorskip("qpsolvers")
    pytest.importorskip(name)
    scene = scenario(SETTINGS["B"], 9, 0, 3)
    ways = []
    for one in ("compiled", name):
        nodes = servo_nodes(scene, "active+", 1.0, one)
        nodes["camera"]["noise"] = 5e-4
        result, streams = pipeline(nodes)
        assert result.exit_code == 0
        assert len(streams["servo.state"]) == 301
        assert all(state.solved for state in streams["servo.state"])
        assert max(np.linalg.norm(m.v) for m in streams["servo.twist"]) <= 0.1
        assert max(np.linalg.norm(m.w) for m in streams["servo.twist"]) <= 0.15
        ways.append(np.array([m.position for m in streams["camera.camera"]]))
    assert np.linalg.norm(ways[0][-1]) > 0.2
    np.testing.assert_allclose(ways[1], ways[0], atol=1e-4)


def test_osqp_repeats_itself(pipeline):
    pytest.importorskip("qpsolvers")
    pytest.importorskip("osqp")
    scene = scenario(SETTINGS["hard"], 4, 0, 0)
    nodes = servo_nodes(scene, "active", 1.0, "osqp", duration=2.0)
    first, second = ([(m.v.tolist(), m.w.tolist()) for m in pipeline(nodes)[1]["servo.twist"]] for _ in range(2))
    assert first == second


@pytest.mark.parametrize("name", ["compiled", "clarabel"])
def test_every_exact_solver_reaches_the_goal(pipeline, name):
    pytest.importorskip({"compiled": "numba"}.get(name, name))
    scene = scenario(SETTINGS["B"], 5, 3, 1)
    ends = []
    for mode in ("active+", "ekf"):
        result, streams = pipeline(servo_nodes(scene, mode, 1.0, name))
        assert result.exit_code == 0
        twists = streams["servo.twist"]
        assert max(np.linalg.norm(m.v) for m in twists) <= 0.1
        assert max(np.linalg.norm(m.w) for m in twists) <= 0.15
        assert all(state.solved for state in streams["servo.state"])
        ends.append(np.linalg.norm(streams["camera.truth"][-1].points - scene.goal))
    assert max(ends) < 0.01


@pytest.mark.parametrize(
    ("variant", "circle"), [("spica14", 0.0), ("varying-depth", 0.0), ("constant-depth", 0.0), ("varying-depth", 0.1)]
)
def test_one_point_runs_alike_as_a_pipeline_and_in_the_batch(pipeline, variant, circle):
    batch = single(variant, circle=circle, duration=8.0)
    goal = [0.0, 0.0] if variant == "spica14" else [0.2, 0.1]
    start = [batch["x"][0], batch["y"][0], 1.0]
    result, streams = pipeline(
        {
            "camera": {
                "plugin": "sim-camera", "points": [[float(x) for x in start]], "duration": 8.0,
                "inputs": {"command": "servo.twist"},
            },
            "depths": {"plugin": "depth-fixed-gain", "guess": 0.1, "inputs": {"twist": "camera.applied"}},
            "servo": {"plugin": "single-point", "goal": goal, "variant": variant, "radius": circle},
        }
    )  # fmt: skip
    assert result.exit_code == 0
    np.testing.assert_allclose([m.chi[0] for m in streams["depths.depths"]], batch["chi_hat"], atol=1e-6)
    np.testing.assert_allclose([m.points[0, 0] for m in streams["camera.truth"]], batch["x"], atol=1e-6)
    for message in streams["depths.depths"][1:]:
        assert message.conditions.shape == (1, 3)
        assert message.conditions[0, 2]
        assert message.sigma2[0] == pytest.approx(0.01, abs=1e-9)
    if variant != "spica14":
        assert all(message.conditions.all() for message in streams["depths.depths"][1:])


def test_a_base_backs_up_and_drives_to_the_goal_view(pipeline):
    points, goal, guess = depth_robot.scene(9, 5, 2)
    result, streams = pipeline(
        {
            "camera": {
                "plugin": "sim-camera", "points": points.tolist(), "base_offset": 0.08, "duration": 20.0,
                "noise": 5e-4, "view": [0.7, 0.5], "inputs": {"twist": "drive.twist"},
            },
            "depths": {
                "plugin": "depth-ekf", "noise": 5e-4, "guess": {str(i): float(c) for i, c in enumerate(guess)},
                "inputs": {"twist": "camera.applied"},
            },
            "drive": {"plugin": "active-base", "goal": {str(i): g for i, g in enumerate(goal.tolist())}},
        }
    )  # fmt: skip
    assert result.exit_code == 0
    back = -min(m.position[2] for m in streams["camera.camera"])
    assert 0.05 < back <= 0.3 + 1e-6
    assert max(abs(m.vx) for m in streams["drive.twist"]) <= 0.2
    phases = [state.phase for state in streams["drive.state"]]
    assert phases[0] == 1
    assert phases[-1] == 3
    turned = next(k for k, phase in enumerate(phases) if phase != 1)
    truth, found = streams["camera.truth"][turned], streams["depths.depths"][turned]
    np.testing.assert_array_equal(truth.ids, found.ids)
    assert np.abs(truth.chi / found.chi - 1).max() < 0.05
    end = streams["camera.truth"][-1]
    assert np.linalg.norm(end.points - goal[end.ids]) < 0.02


def test_without_a_goal_a_base_comes_back_to_its_first_view(pipeline):
    points, _, guess = depth_robot.scene(9, 5, 3)
    result, streams = pipeline(
        {
            "camera": {
                "plugin": "sim-camera", "points": points.tolist(), "base_offset": 0.08, "duration": 15.0,
                "noise": 5e-4, "view": [0.7, 0.5], "inputs": {"twist": "drive.twist"},
            },
            "depths": {
                "plugin": "depth-ekf", "noise": 5e-4, "guess": {str(i): float(c) for i, c in enumerate(guess)},
                "inputs": {"twist": "camera.applied"},
            },
            "drive": {"plugin": "active-base"},
        }
    )  # fmt: skip
    assert result.exit_code == 0
    along = [m.position[2] for m in streams["camera.camera"]]
    assert min(along) < -0.05
    assert streams["drive.state"][-1].phase == 3
    first, last = streams["camera.truth"][0], streams["camera.truth"][-1]
    seen = np.isin(first.ids, last.ids)
    assert np.linalg.norm(last.points - first.points[seen]) < 0.02


@pytest.mark.parametrize("method", ["rays", "dlt"])
def test_triangulation_knows_the_depth_once_the_camera_has_moved(pipeline, method):
    scene = scenario(SETTINGS["B"], 6, 3, 0)
    nodes = servo_nodes(scene, "ideal", 1.0, duration=4.0)
    nodes["depths"] = {"plugin": "triangulation", "method": method}
    result, streams = pipeline(nodes)
    assert result.exit_code == 0
    found, truth = streams["depths.depths"], streams["camera.truth"]
    assert np.isnan(found[0].chi).all()
    assert np.isinf(found[0].condition).all()
    np.testing.assert_allclose(found[-1].chi, truth[-1].chi, rtol=1e-6)
    assert (found[-1].condition < found[2].condition).all()


def test_every_mode_of_the_experiment_is_one_of_the_policy():
    assert set(MODES) == {"ideal", "passive", "active", "active+", "ekf", "ekf active+"}


def test_losing_features_and_noise_do_not_keep_it_from_the_goal(pipeline):
    scene = scenario(SETTINGS["B"], 6, 3, 4)
    nodes = servo_nodes(scene, "ekf active+", 1.0)
    nodes["camera"] |= {"loss": 0.2, "noise": 1e-3, "hidden": [{"ids": [0, 1], "start": 2.0, "end": 2.6}]}
    result, streams = pipeline(nodes)
    assert result.exit_code == 0
    seen = [len(m.ids) for m in streams["camera.features"]]
    assert min(seen) < 6
    assert not any({0, 1} & set(m.ids.tolist()) for m in streams["camera.features"][40:52])
    rotation, position = streams["camera.camera"][-1].rotation, streams["camera.camera"][-1].position
    image, _ = project((scene.points - position) @ rotation)
    assert np.linalg.norm(image - scene.goal) < 0.01
