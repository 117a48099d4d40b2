"""What a map must do: built and questioned in a room whose walls are known in closed form."""

import typing
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from knotwork.core.conformance.room import Room, scan_of
from knotwork.core.conformance.suite import NodeSuite
from knotwork.core.contracts import Alignment, Loss, NormalEquations
from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.messages import F64

LOSSES: tuple[Loss, ...] = typing.get_args(Loss)
_OFF = np.array([0.04, -0.03, 0.02])  # m, m, rad: where the terms are tried, off the true pose
_STEP = 1e-4  # m, rad: of finite differences


class MapSuite(NodeSuite):
    """Checks of maps.

    Attributes
    ----------
    room
        The room that is mapped.
    scans
        So many scans are fused; a map may ask for more before it believes them.
    gradient_tolerance
        Largest relative error of the cost's gradient against finite differences.
    """

    kind = "map"
    room: ClassVar[Room] = Room()
    scans: ClassVar[int] = 12
    gradient_tolerance: ClassVar[float] = 0.03

    def built(self, folder: Path, room: Room | None = None, offset: float = 0.0, node: Any = None) -> Any:
        """Return a map of `room`, fused from true poses; `offset` [m] moves the whole along x."""
        room = room or self.room
        node = node or self.node(self.context(folder))
        for number, pose in enumerate(room.poses(self.scans)):
            scan = room.scan(pose, scan_id=number, stamp=number * 200_000_000, noise=0.005)
            node.context.advance(scan.stamp)
            node.update(scan, pose + np.array([offset, 0.0, 0.0]))
        return node

    def off(self, node: Any) -> tuple[Alignment, F64, F64]:
        """Return an alignment of a new scan, its true pose and a pose off it."""
        truth = np.array([0.3, -0.2, 0.5])
        scan = self.room.scan(truth, scan_id=99)
        return node.alignment(scan, truth + _OFF), truth, truth + _OFF

    def walls(self) -> F64:
        """Return points (n, 2) on the walls, half a metre off the corners."""
        x, y = self.room.width / 2, self.room.depth / 2
        along_x, along_y = np.linspace(0.5 - x, x - 0.5, 60), np.linspace(0.5 - y, y - 0.5, 60)
        sides = [(along_x, np.full(60, s * y)) for s in (-1, 1)] + [(np.full(60, s * x), along_y) for s in (-1, 1)]
        walls: F64 = np.vstack([np.column_stack(side) for side in sides]) + self.room.middle
        return walls

    def inside(self) -> F64:
        """Return points (n, 2) in the middle of the room, free in truth."""
        x, y = np.meshgrid(np.linspace(-0.3, 0.3, 15) * self.room.width, np.linspace(-0.3, 0.3, 15) * self.room.depth)
        inside: F64 = np.column_stack([x.ravel(), y.ravel()]) + self.room.middle
        return inside

    # ---- what it says of space

    def test_empty(self, tmp_path: Path) -> None:
        """A fresh map knows nothing and answers all the same."""
        node = self.node(self.context(tmp_path))
        assert node.empty() is True
        assert np.all(node.occupancy(self.inside()) == 0)
        alignment, truth, _ = self.off(node)
        for level in range(node.levels):
            terms = alignment.normal_equations(truth, level)
            _check_terms(terms, 360)
            assert terms.n_used == 0, "beams cannot meet a map that is empty"
        node.rasterize()

    def test_occupancy(self, tmp_path: Path) -> None:
        """Walls are occupied, the middle is free, far away is unknown, all within [-1, 1]."""
        node = self.built(tmp_path)
        assert node.empty() is False
        walls, inside = node.occupancy(self.walls()), node.occupancy(self.inside())
        assert walls.shape == (240,)
        for values in (walls, inside):
            assert np.all((values >= -1) & (values <= 1)), f"outside [-1, 1]: {values.min()}, {values.max()}"
        assert np.mean(walls > 0) > 0.9, f"{np.mean(walls > 0):.0%} of the walls are occupied"
        assert np.mean(inside < 0) > 0.9, f"{np.mean(inside < 0):.0%} of the middle is free"
        assert np.all(node.occupancy(np.array([[500.0, 0.0], [-500.0, 3.0], [0.0, 1e6]])) == 0), "far away is unknown"
        assert node.occupancy(np.empty((0, 2))).shape == (0,)

    def test_robot_pose_not_sensor_pose(self, tmp_path: Path) -> None:
        """Poses are the robot's: a sensor mounted aside and turned maps the same walls."""
        node = self.node(self.context(tmp_path))
        for number, pose in enumerate(self.room.poses(self.scans)):
            node.update(self.room.scan(pose, scan_id=number, mount=(0.3, 0.2, 0.7)), pose)
        assert np.mean(node.occupancy(self.walls()) > 0) > 0.9

    def test_rasterize(self, tmp_path: Path) -> None:
        """Cells are int8 in [-1, 100], lie where their origin says and show walls and free space."""
        node = self.built(tmp_path)
        for asked in (None, 0.1):
            cells, resolution, origin = node.rasterize(asked)
            assert cells.dtype == np.int8
            assert cells.ndim == 2
            assert cells.min() >= -1
            assert cells.max() <= 100
            assert resolution > 0
            assert asked is None or resolution == pytest.approx(asked)
            assert len(origin) == 3
            assert origin[2] == 0, "maps are rastered along their axes"
            free = _cell(cells, resolution, origin, self.inside())
            assert np.mean((free >= 0) & (free < 50)) > 0.9
            # A wall may fall on the border of two cells.
            steps = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2) * resolution
            near = [self.walls() + step for step in steps]
            wall = np.max([_cell(cells, resolution, origin, points) for points in near], axis=0)
            assert np.mean(wall > 50) > 0.9

    # ---- what it says of a scan

    def test_normal_equations(self, tmp_path: Path) -> None:
        """H is symmetric and not negative, counts are counts, for every level and loss."""
        node = self.built(tmp_path)
        alignment, _, pose = self.off(node)
        assert alignment.levels == node.levels >= 1
        for level in range(node.levels):
            for loss in LOSSES:
                terms = alignment.normal_equations(pose, level, loss)
                _check_terms(terms, 360)
                assert terms.n_used > 180, f"level {level}: {terms.n_used} of 360 beams meet a map of the whole room"

    def test_gradient(self, tmp_path: Path) -> None:
        """G is half the gradient of the cost: against central differences, for every level and loss."""
        alignment, _, pose = self.off(self.built(tmp_path))
        for level in range(alignment.levels):
            for loss in LOSSES:
                g = alignment.normal_equations(pose, level, loss).g
                numeric = np.empty(3)
                for axis, step in enumerate(np.eye(3) * _STEP):
                    pair = np.array([pose + step, pose - step])
                    numeric[axis] = np.subtract(*alignment.costs(pair, level, loss)) / (4 * _STEP)
                error = np.linalg.norm(g - numeric) / max(float(np.linalg.norm(numeric)), 1e-9)
                assert error < self.gradient_tolerance, f"level {level}, {loss}: g {g}, by differences {numeric}"

    def test_costs_agree(self, tmp_path: Path) -> None:
        """`costs` is the cost of `normal_equations`, and without a loss the sum of squared residuals."""
        alignment, truth, pose = self.off(self.built(tmp_path))
        poses = np.array([truth, pose, truth - _OFF])
        for level in range(alignment.levels):
            for loss in LOSSES:
                single = [alignment.normal_equations(p, level, loss).cost for p in poses]
                assert alignment.costs(poses, level, loss) == pytest.approx(single, rel=1e-6)
            r, _ = alignment.residuals(pose, level)
            assert alignment.normal_equations(pose, level).cost == pytest.approx(float(r @ r), rel=1e-4)

    def test_jacobian(self, tmp_path: Path) -> None:
        """The residuals' Jacobian is their derivative: against central differences, but for a few at an edge."""
        alignment, _, pose = self.off(self.built(tmp_path))
        for level in range(alignment.levels):
            r, jacobian = alignment.residuals(pose, level)
            assert jacobian.shape == (len(r), 3)
            numeric = np.empty_like(jacobian)
            for axis, step in enumerate(np.eye(3) * _STEP):
                after, before = alignment.residuals(pose + step, level)[0], alignment.residuals(pose - step, level)[0]
                assert len(after) == len(before) == len(r), "the residuals of one alignment keep their number"
                numeric[:, axis] = (after - before) / (2 * _STEP)
            wrong = np.abs(jacobian - numeric).max(axis=1) > 0.02 * max(float(np.abs(numeric).max()), 1e-9)
            assert wrong.mean() < 0.05, f"level {level}: {wrong.mean():.0%} of the rows differ"

    def test_pulls_towards_the_truth(self, tmp_path: Path) -> None:
        """The cost is lower and more beams fit at the true pose than 10 cm or 6 deg off it."""
        alignment, truth, _ = self.off(self.built(tmp_path))
        away = truth + np.array([[0.1, 0, 0], [-0.1, 0, 0], [0, 0.1, 0], [0, -0.1, 0], [0, 0, 0.1], [0, 0, -0.1]])
        for level in range(alignment.levels):
            costs = alignment.costs(np.vstack([truth, away]), level)
            assert costs.shape == (7,)
            assert np.all(costs[0] < costs[1:]), f"level {level}: cost at the truth {costs[0]}, off it {costs[1:]}"
        finest = alignment.levels - 1
        good, bad = alignment.inliers(truth, finest), alignment.inliers(truth + np.array([0.6, 0.6, 0.4]), finest)
        assert 0 <= bad < good <= 1, f"inliers {good} at the truth, {bad} far off"
        assert good > 0.7

    # ---- updates

    def test_fuse_false_changes_nothing(self, tmp_path: Path) -> None:
        """Localisation only: the map stays bit by bit as it is."""
        node = self.built(tmp_path)
        points = np.vstack([self.walls(), self.inside()])
        before = node.occupancy(points).tobytes()
        pose = np.array([0.5, 0.5, 1.0])
        scan = self.room.scan(pose, scan_id=50)
        node.update(scan, pose + 0.3, fuse=False)
        node.update(scan, pose + 0.3, node.alignment(scan, pose), fuse=False)
        assert node.occupancy(points).tobytes() == before

    def test_update_through_an_alignment(self, tmp_path: Path) -> None:
        """Handing over the scan's alignment spares work and changes nothing."""
        maps = [self.built(tmp_path / name) for name in "ab"]
        pose = np.array([0.2, 0.1, 0.4])
        scan = self.room.scan(pose, scan_id=50)
        maps[0].update(scan, pose)
        maps[1].update(scan, pose, maps[1].alignment(scan, pose))
        assert maps[0].occupancy(self.walls()) == pytest.approx(maps[1].occupancy(self.walls()), abs=1e-5)

    def test_same_again(self, tmp_path: Path) -> None:
        """Two maps of the same scans are the same, bit by bit."""
        first, second = self.built(tmp_path / "first"), self.built(tmp_path / "second")
        assert first.rasterize()[0].tobytes() == second.rasterize()[0].tobytes()
        assert first.occupancy(self.walls()).tobytes() == second.occupancy(self.walls()).tobytes()

    def test_poor_scans(self, tmp_path: Path) -> None:
        """Scans without a return, of NaN, of one beam and of none are survived, by an empty map and by a full one."""
        pose = np.array([0.1, 0.2, 0.3])
        scans = [[np.inf] * 90, [np.nan] * 90, [1.0], [np.inf], [], [0.0] * 10, [0.001] * 10, [1e6] * 10]
        for node in (self.node(self.context(tmp_path / "empty")), self.built(tmp_path / "full")):
            for number, ranges in enumerate(scans):
                scan = scan_of(ranges, scan_id=100 + number)
                alignment = node.alignment(scan, pose)
                for level in range(node.levels):
                    _check_terms(alignment.normal_equations(pose, level, "cauchy"), len(ranges))
                    assert 0 <= alignment.inliers(pose, level) <= 1
                    r, jacobian = alignment.residuals(pose, level)
                    assert jacobian.shape == (len(r), 3)
                node.update(scan, pose, alignment)
            assert np.all(np.isfinite(node.occupancy(self.inside())))

    # ---- memory and files

    def test_memory(self, tmp_path: Path) -> None:
        """Memory is counted, grows with the area seen and does not pay for the space between two rooms."""
        small = self.built(tmp_path / "small")
        large = self.built(tmp_path / "large", Room(3 * self.room.width, 3 * self.room.depth))
        one = small.nbytes
        assert one > 0
        assert large.nbytes > one
        both = self.built(tmp_path, offset=1000.0, node=small).nbytes
        assert both < 4 * one, f"one room takes {one} bytes, two of them 1 km apart {both}"

    def test_save_and_load(self, tmp_path: Path) -> None:
        """A file brings the map back."""
        node = self.built(tmp_path / "first")
        file = tmp_path / "map.bin"
        node.save(file)
        fresh = self.node(self.context(tmp_path / "second"))
        fresh.load(file)
        assert fresh.empty() is False
        points = np.vstack([self.walls(), self.inside()])
        assert fresh.occupancy(points) == pytest.approx(node.occupancy(points), abs=1e-6)
        assert fresh.nbytes > 0
        alignment, _, pose = self.off(node)
        again, _, _ = self.off(fresh)
        assert again.costs(pose[None], 0) == pytest.approx(alignment.costs(pose[None], 0), rel=1e-5)

    def test_damaged_file(self, tmp_path: Path) -> None:
        """Cut off, a bit flipped, foreign, missing: an InputError (missing: a KnotworkError), never a wrong map."""
        node = self.built(tmp_path / "map")
        file = tmp_path / "map.bin"
        node.save(file)
        whole = file.read_bytes()
        rng = np.random.default_rng(0)
        damaged = [b"", b"not a map\n" * 100]
        damaged += [whole[:n] for n in (1, 16, len(whole) // 2, len(whole) - 1)]
        for place in (*range(0, 64, 7), *rng.integers(0, len(whole), 20).tolist()):
            flipped = bytearray(whole)
            flipped[place % len(whole)] ^= 1 << int(rng.integers(0, 8))
            damaged.append(bytes(flipped))
        bad = tmp_path / "bad.bin"
        for content in damaged:
            bad.write_bytes(content)
            with pytest.raises(InputError):
                self.node(self.context(tmp_path / "load")).load(bad)
        with pytest.raises(KnotworkError):
            node.load(tmp_path / "missing.bin")


def _check_terms(terms: NormalEquations, beams: int) -> None:
    assert terms.H.shape == (3, 3)
    assert terms.g.shape == (3,)
    assert np.all(np.isfinite(terms.H))
    assert np.all(np.isfinite(terms.g))
    assert np.isfinite(terms.cost)
    assert terms.cost >= 0
    scale = max(float(np.abs(terms.H).max()), 1e-300)
    assert np.allclose(terms.H, terms.H.T, rtol=0, atol=1e-9 * scale), "H is not symmetric"
    assert np.linalg.eigvalsh(terms.H).min() >= -1e-7 * scale, "H has a negative direction"
    assert 0 <= terms.n_used <= terms.n_total <= beams


def _cell(cells: Any, resolution: float, origin: tuple[float, float, float], points: F64) -> Any:
    columns = np.floor((points[:, 0] - origin[0]) / resolution).astype(int)
    rows = np.floor((points[:, 1] - origin[1]) / resolution).astype(int)
    inside = (rows >= 0) & (rows < cells.shape[0]) & (columns >= 0) & (columns < cells.shape[1])
    return np.where(inside, cells[rows.clip(0, cells.shape[0] - 1), columns.clip(0, cells.shape[1] - 1)], -1)
