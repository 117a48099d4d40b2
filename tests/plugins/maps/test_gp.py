import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import Matern

from knotwork.core.cli.main import main
from knotwork.core.conformance import RecordingContext
from knotwork.core.conformance.room import Room, scan_of
from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.messages import Pose
from knotwork.plugins.maps.gp import MANIFEST
from knotwork.plugins.maps.gp.map import GpMap

ROOM = Room(3.0, 2.5)


@pytest.fixture
def gp(tmp_path):
    def make(options=None, **config) -> GpMap:
        return GpMap(RecordingContext(MANIFEST, config, options=options, out=tmp_path))

    return make


def test_one_scan_is_the_regression_of_its_ends_and_its_ways(gp):
    """The committee of one member is the member: against scikit-learn on the same points."""
    chart = gp()
    pose = np.array([0.7, -0.3, 0.4])
    scan = ROOM.scan(pose, beams=90)
    chart.update(scan, pose)
    points, labels = chart._training(scan, pose)
    assert np.all(np.abs(ROOM.distance(points[labels > 0])[0]) < 1e-5)
    process = GaussianProcessRegressor(Matern(0.25, nu=1.5), alpha=0.01, optimizer=None).fit(points, labels)
    centres = (np.floor(points[::7] / 0.1) + 0.5) * 0.1
    assert chart.occupancy(centres) == pytest.approx(np.clip(process.predict(centres), -1, 1), abs=1e-3)


def test_scans_are_fused_at_the_pose_of_the_same_number_whichever_comes_first(gp):
    pose = np.array([0.6, -0.4, 0.0])
    maps = [gp(), gp(), gp()]
    scan = ROOM.scan(pose, beams=60, scan_id=7)
    estimate = Pose(stamp=0, role="estimate", pose=pose, scan_id=7)
    maps[0].update(scan, pose)
    maps[1].on_scan(scan)
    maps[1].on_pose(estimate)
    maps[2].on_pose(estimate)
    maps[2].on_scan(scan)
    at = np.random.default_rng(0).uniform(-1, 2, (200, 2))
    for chart in maps[1:]:
        assert chart.occupancy(at).tobytes() == maps[0].occupancy(at).tobytes()
    before = maps[1].occupancy(at).tobytes()
    maps[1].on_scan(ROOM.scan(pose, beams=60, scan_id=8))  # the robot has not moved
    maps[1].on_pose(Pose(stamp=0, role="estimate", pose=pose, scan_id=8))
    assert maps[1].occupancy(at).tobytes() == before


def test_save_load_and_what_is_refused(gp, tmp_path):
    chart = gp()
    assert chart.empty()
    for ranges in ([np.inf] * 9, [np.nan] * 9, []):
        chart.update(scan_of(ranges), np.zeros(3))
    assert chart.empty()
    pose = np.array([0.6, -0.4, 0.0])
    chart.update(ROOM.scan(pose, beams=60), pose, fuse=False)
    assert chart.empty()
    chart.update(ROOM.scan(pose, beams=60), pose)
    chart.save(tmp_path / "gp.map")
    again = gp()
    again.load(tmp_path / "gp.map")
    assert not again.empty()
    assert again.rasterize()[0].tobytes() == chart.rasterize()[0].tobytes()
    whole = (tmp_path / "gp.map").read_bytes()
    (tmp_path / "bad.map").write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    with pytest.raises(InputError, match="damaged"):
        again.load(tmp_path / "bad.map")
    with pytest.raises(KnotworkError, match="cannot be aligned with"):
        chart.alignment(ROOM.scan(pose), pose)


def test_a_localiser_refuses_it_before_the_run(tmp_path, capsys):
    file = tmp_path / "pipeline.yaml"
    file.write_text(
        "pipeline: mistaken\nnodes:\n"
        "  sim: {plugin: sim2d, duration: 1}\n"
        "  prior: {plugin: ekf}\n"
        "  map: {plugin: gp}\n"
        "  localizer: {plugin: gauss-newton, uses: {map: map, prior: prior}}\n"
    )
    assert main(["validate", str(file)]) == 2
    error = capsys.readouterr()
    assert "does not provide a map" in error.out + error.err
