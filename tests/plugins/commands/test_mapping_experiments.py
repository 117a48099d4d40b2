"""The mapping experiments: their measures against closed forms, and a small run of each."""

import json
from dataclasses import dataclass

import numpy as np
import pytest

from knotwork.core.bare_context import BareContext
from knotwork.core.cli.main import main
from knotwork.core.contracts import NormalEquations
from knotwork.core.messages import Scan
from knotwork.plugins.commands.experiment import circular_room, corridor_memory, map_timing, pillars, square_room
from knotwork.plugins.commands.experiment.bare_map import build_map, fused_as, turn
from knotwork.plugins.commands.experiment.map_error import FAR, pose_error, range_errors, residual_error
from knotwork.plugins.commands.experiment.tours import poses_along, scans_along

ANGLES = 2.0 * np.pi * np.arange(360) / 360


def run(capsys, name, *arguments):
    assert main(["experiment", name, *arguments, "--jobs", "1", "--json"]) == 0
    return json.loads(capsys.readouterr().out)


# ---- what the sensor would see


def test_distances_in_the_rooms_are_those_of_geometry():
    square = 2.05 / np.maximum(np.abs(np.cos(ANGLES)), np.abs(np.sin(ANGLES)))
    assert np.allclose(square_room.ranges_in(4.10), square, atol=1e-12)
    pose = np.array((0.4, -0.3, 0.7))
    x = pose[0] + circular_room.ranges_in(pose) * np.cos(ANGLES + 0.7)
    y = pose[1] + circular_room.ranges_in(pose) * np.sin(ANGLES + 0.7)
    assert np.allclose(np.hypot(x, y), 2.0, atol=1e-12)


def test_poses_lie_on_the_path_and_look_along_it():
    poses = poses_along(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 2.0)]), 0.25)
    assert len(poses) == 12
    assert np.allclose(poses[2], (0.5, 0.0, 0.0))
    assert np.allclose(poses[6], (1.0, 0.5, np.pi / 2))


def test_scans_along_a_path_hit_the_walls_of_the_world():
    scans = scans_along("room", "tour", 1.0, 0)
    for scan, (x, y, yaw) in scans:
        angles = yaw + scan.mount[2] + scan.angle_min + scan.angle_increment * np.arange(360)
        ox, oy = x + scan.mount[0] * np.cos(yaw), y + scan.mount[0] * np.sin(yaw)
        hit = np.stack((ox + scan.ranges * np.cos(angles), oy + scan.ranges * np.sin(angles)))
        seen = np.isfinite(scan.ranges)
        off = np.abs(np.abs(hit[:, seen]).max(axis=0) - 2.0)
        assert off.max() < 6 * (0.0026 * 3.5 + 0.00253)  # (3.16), 6 sigma


# ---- what the measures measure


@dataclass
class Ridge:
    """A map whose residual is (distance of a beam's end from a circle of radius `wall`) / `unit`, flat over `flat`."""

    wall: float
    flat: float = 0.0
    unit: float = 0.1
    floor: float = 0.0  # residual at the ridge

    def alignment(self, scan, guess, motion=None):
        return RidgeAlignment(self, scan.ranges.astype(float))


@dataclass
class RidgeAlignment:
    chart: Ridge
    ranges: np.ndarray

    def residuals(self, pose, level):
        if pose[0] == FAR:
            return np.full(len(self.ranges), 10.0), np.zeros((len(self.ranges), 3))
        off = np.abs(self.ranges - self.chart.wall)
        off = np.maximum(off - self.chart.flat, 0.0)
        return self.chart.floor + off / self.chart.unit, np.zeros((len(self.ranges), 3))

    def normal_equations(self, pose, level):
        """A bowl whose bottom lies (3, 4) cm beside the true place."""
        off = pose - self.bottom
        H = np.diag((2.0, 5.0, 1.0))
        return NormalEquations(H, H @ off, float(off @ H @ off), 1, 1)


@pytest.mark.parametrize("flat", [0.0, 0.04])
def test_the_ridge_is_found_where_it_is(flat):
    errors = range_errors(Ridge(2.03, flat), np.full(360, 2.0), 0.2, 0.0025)
    assert np.allclose(errors, 0.03, atol=1e-6)


def test_the_residual_is_a_share_of_that_of_the_unknown():
    assert residual_error(Ridge(2.1), np.full(360, 2.0)) == pytest.approx((0.1 / 0.1 / 10.0) ** 2, rel=1e-5)
    assert residual_error(Ridge(2.0), np.full(360, 2.0)) == pytest.approx(0.0, abs=1e-12)


def test_an_unbounded_map_is_measured_by_the_most_it_holds():
    # It holds 1 - 0.1 / 0.1 / 10 = 0.9 of what a bound would be at the wall, all of it 0.1 m behind.
    assert residual_error(Ridge(2.1), np.full(360, 2.0), 0.2, 0.01) == pytest.approx(0.01, rel=1e-4)
    # One that holds half as much everywhere is as good.
    half = Ridge(2.1, unit=0.2)
    half.floor = 5.0
    assert residual_error(half, np.full(360, 2.0), 0.2, 0.01) == pytest.approx(0.01, rel=1e-4)


def test_a_round_room_tells_the_distance_from_its_middle_only():
    turned = np.array((0.3 * np.cos(2.0), 0.3 * np.sin(2.0), 5.0))
    assert circular_room.off_centre(turned, np.array((0.3, 0.0, 0.0))) == pytest.approx(0.0, abs=1e-12)
    assert circular_room.off_centre(np.array((0.0, -0.31, 0.0)), np.array((0.3, 0.0, 0.0))) == pytest.approx(0.01)


def test_beam_by_beam_is_the_whole_scan_in_parts():
    scan = turn(np.linspace(1.0, 2.0, 7), 3.5)
    assert fused_as("nearest", scan) == [scan]
    parts = np.array([part.ranges for part in fused_as("textbook", scan)])
    assert np.array_equal(np.diag(parts), scan.ranges)
    assert np.count_nonzero(np.isnan(parts)) == 42


def test_the_pose_error_is_the_distance_to_the_bottom_of_the_cost():
    class Bowl(Ridge):
        def alignment(self, scan, guess, motion=None):
            made = RidgeAlignment(self, scan.ranges.astype(float))
            made.bottom = guess + np.array((0.03, 0.04, 0.1))
            return made

    assert pose_error(Bowl(2.0), lambda pose: np.full(360, 2.0)) == pytest.approx(0.05, rel=1e-6)


def test_below_compares_with_each_grid_by_itself():
    rows = [{"residual": 0.1, "pose_m": 0.1, "range_m": 0.1}, {"residual": 0.3, "pose_m": 0.1, "range_m": 0.1}]
    other = [{"residual": 0.2, "pose_m": 0.2, "range_m": 0.1}, {"residual": 0.2, "pose_m": 0.2, "range_m": 0.1}]
    found = square_room.below({"surface": rows, "bilinear": other, "tsdf": other})
    assert found == {
        "residual": {"bilinear": [True, False]},
        "pose_m": {"bilinear": [True, True]},
        "range_m": {"bilinear": [False, False]},
    }


def test_memory_is_counted_as_section_6_5_does():
    rows = {
        "grid 0.05": {"nbytes": 9000, "explored_cells": 4200, "thesis_bytes": 4200},
        "curve": {"nbytes": 3000, "curves": 10, "control_points": 100, "thesis_bytes": 9 * 100 + 12 * 10},
    }
    found = corridor_memory.compared(rows)["curve"]
    assert found["grid_ratio"] == 3.0
    assert found["thesis_ratio"] == pytest.approx(4200 / 1020)


def test_a_circle_is_fitted_to_a_ring():
    angles = np.linspace(0.3, 5.0, 200)  # most of it
    ring = np.column_stack((1.1 + 0.15 * np.cos(angles), -0.2 + 0.15 * np.sin(angles)))
    assert np.allclose(pillars.fit_circle(ring, np.array((1.0, 0.0, 0.2))), (1.1, -0.2, 0.15), atol=1e-6)


def test_a_pillar_that_is_missing_or_wrong_is_said():
    circles = np.column_stack((pillars.CENTRES + np.array((0.003, 0.004)), np.full(9, 0.152)))
    good = pillars.errors_of(circles)
    assert (good["found"], good["others"]) == (9, 0)
    assert good["centre_max_m"] == pytest.approx(0.005)
    assert good["radius_mean_m"] == pytest.approx(0.002)
    missing = pillars.errors_of(np.vstack((circles[1:], [[2.5, 2.5, 0.1]])))
    assert (missing["found"], missing["others"]) == (8, 1)
    assert missing["pillars"][0]["centre_error_m"] is None
    assert pillars.errors_of(np.empty((0, 3)))["found"] == 0


def test_the_ridge_of_a_ring_is_found_all_round():
    chart = build_map("surface", (0.01,), clamp=1000.0)
    for x in (-1.0, 1.0):  # from both sides; a scan of the ring alone
        angles = np.linspace(-0.15, 0.15, 361)
        ahead = 1.0 * np.cos(angles) - np.sqrt(0.15**2 - np.sin(angles).clip(-0.149, 0.149) ** 2)
        scan = Scan(
            stamp=0, scan_id=0, ranges=np.where(np.abs(np.sin(angles)) < 0.149, ahead, np.inf).astype(np.float32),
            angle_min=-0.15, angle_increment=0.3 / 360, range_min=0.0, range_max=3.0,
        )  # fmt: skip
        for _ in range(5):
            chart.update(scan, np.array((x, 0.0, 0.0 if x < 0 else np.pi)))
    ridge = pillars.ridge_around(chart, np.array((0.01, 0.0)))
    off = np.hypot(*ridge.T) - 0.15
    assert len(ridge) > 80
    assert np.abs(off).max() < 0.01
    assert np.abs(np.median(off)) < 0.004


# ---- small runs


def test_a_square_room_is_mapped_and_compared(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(square_room, "SIDES", (4.0, 4.18))
    results = run(capsys, "square-room", "--out", str(tmp_path), "--no-figures")
    rows = results["maps"]["surface"]
    assert [row["side_m"] for row in rows] == [4.0, 4.18]
    for row in rows:
        assert row["residual"] < 1e-4  # nothing known would be 1
        assert row["pose_m"] < 0.005
    below = results["surface_below"]["residual"]
    assert all(all(below[name]) for name in ("textbook", "bilinear", "bicubic")), "Fig. 7.6"
    assert [row["residual"] for row in results["maps"]["nearest"]] == [
        0.0,
        0.0,
    ]  # each beam ends in a cell that was hit
    assert results == json.loads((tmp_path / "results.json").read_text())


def test_a_circular_room_is_mapped_under_noise(capsys, tmp_path):
    arguments = ("--runs", "1", "--scans", "20", "--out", str(tmp_path))
    results = run(capsys, "circular-room", *arguments)
    assert results["clamp"] == "not reached"
    assert all(all(marks) for marks in results["surface_below"]["residual"].values()), "Fig. 7.8"
    assert (tmp_path / "fig-7.8-circular-room.png").is_file()
    again = run(capsys, "circular-room", *arguments, "--no-figures")
    assert again == results


def test_timing_and_memory_speak_of_every_map(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(map_timing, "_EVERY", 3.0)
    timing = run(capsys, "timing", "--runs", "1", "--out", str(tmp_path / "t"), "--no-figures")
    assert timing["update_relative_to_surface"]["surface"] == 1.0
    assert all(row["update_ms"] > 0 for row in timing["maps"].values())
    assert [name for name, row in timing["maps"].items() if not row["align_ms"]] in ([], ["gp"])
    memory = run(capsys, "corridor-memory", "--length", "2", "--out", str(tmp_path / "m"), "--no-figures")
    assert set(memory) == {"corridor-300m", "apartment"}
    fine, pyramid = (memory["corridor-300m"][f"surface {levels}"] for levels in ("0.05", "0.30 0.125 0.05"))
    assert pyramid["nbytes"] > fine["nbytes"]
    # Two metres on in a corridor 2 m wide, seen 3.5 m to each side: between the width times 2 m and 9 m.
    area = fine["explored_cells"] * 0.05**2
    assert 4.0 < area < 20.0


def test_a_map_outside_of_a_run_is_silent_and_has_no_time():
    chart = build_map("surface", (0.1,))
    context = chart.context
    assert isinstance(context, BareContext)
    chart.update(turn(np.full(360, 2.0), 3.5), np.zeros(3))
    chart.finish()
    assert context.now() == 0
    with context.measure("x"):
        context.count("y")


@pytest.mark.data
def test_the_pillars_are_where_the_world_file_says(data, capsys, tmp_path):
    log = data / "turtlebot3_world" / "turtle_world.txt.xz"
    results = run(capsys, "pillars", "--log", str(log), "--out", str(tmp_path), "--no-figures")["maps"]["surface"]
    assert results["found"] == 9
    assert results["centre_max_m"] < 0.01
    assert results["radius_max_m"] < 0.01


def test_a_missing_log_of_pillars_is_one_line(capsys, tmp_path):
    assert main(["experiment", "pillars", "--log", "no.txt", "--out", str(tmp_path)]) == 1
    err = capsys.readouterr().err
    assert "no.txt" in err
    assert len(err.splitlines()) == 1
