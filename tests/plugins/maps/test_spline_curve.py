import math

import numpy as np
import pytest
from scipy.interpolate import make_lsq_spline

from knotwork.core.conformance import RecordingContext
from knotwork.core.conformance.room import Room
from knotwork.core.messages import Scan
from knotwork.core.splines import Curve
from knotwork.plugins.maps.spline_curve import MANIFEST
from knotwork.plugins.maps.spline_curve.association import associate
from knotwork.plugins.maps.spline_curve.fusion import Fusion
from knotwork.plugins.maps.spline_curve.lookup import LookupCache
from knotwork.plugins.maps.spline_curve.map import SplineCurve
from knotwork.plugins.maps.spline_curve.offset import estimate_offset, moved_to_lattice
from knotwork.plugins.maps.spline_curve.queries import convex
from knotwork.plugins.maps.spline_curve.segmentation import Clusters
from knotwork.plugins.maps.spline_curve.store import CurveStore

ROOM = Room()


@pytest.fixture
def curves(tmp_path):
    def make(options=None, **config) -> SplineCurve:
        return SplineCurve(RecordingContext(MANIFEST, config, options=options, out=tmp_path))

    return make


def scan(ranges, angle_min=0.0, angle_increment=0.01, range_max=50.0):
    return Scan(
        stamp=0, scan_id=0, ranges=np.array(ranges, np.float32), angle_min=angle_min,
        angle_increment=angle_increment, range_min=0.05, range_max=range_max,
    )  # fmt: skip


def circle(radius=2.0, beams=360, **keys):
    return scan(np.full(beams, radius), angle_increment=2 * np.pi / beams, **keys)


# ---- fits, merges, offsets


def piece(step=0.1, smoothness=1e-9):
    return Fusion(CurveStore(step), 0.15, smoothness, 50.0, 8)


def test_a_fit_is_scipys_least_squares_spline():
    rng = np.random.default_rng(1)
    tau = np.sort(rng.uniform(0.3, 1.5, 300))
    points = np.column_stack([np.cos(tau), np.sin(2 * tau)]) + 0.01 * rng.standard_normal((300, 2))
    ours = piece()._fit(tau, points)
    assert ours.domain == pytest.approx((0.3, 1.5))
    theirs = make_lsq_spline(tau, points, ours.basis.knots(len(ours.control)), k=3)
    assert ours.control == pytest.approx(theirs.c, abs=1e-5)


def test_merging_two_scans_is_the_fit_of_both():
    """Theorem 6.1 against least squares of all the data at once."""
    rng = np.random.default_rng(2)
    tau = np.linspace(0.0, 2.0, 400)
    truth = np.column_stack([tau, np.sin(3 * tau)])
    a, b = (truth + 0.02 * rng.standard_normal(truth.shape) for _ in range(2))
    work = piece()
    merged = work._fit(tau, a).merge(work._fit(tau, b))
    both = work._fit(np.concatenate([tau, tau]), np.concatenate([a, b]))
    assert merged.control == pytest.approx(both.control, abs=1e-6)


@pytest.mark.parametrize("shift", [0.03, -0.17, 0.4])
def test_the_offset_between_two_curves_is_found(shift):
    mapped = Curve.fit(t := np.linspace(0, 6, 600), np.column_stack([t, np.sin(2 * t)]), 0.1)
    t = np.linspace(1, 3, 300)
    seen = Curve.fit(t, np.column_stack([t + shift, np.sin(2 * (t + shift))]), 0.1)
    found = estimate_offset(mapped, seen, shift + 0.05)
    assert found is not None
    assert found[0] == pytest.approx(shift, abs=1e-4)
    assert found[1] < 1e-3
    assert found[2] == pytest.approx(2.0, abs=0.1)
    assert estimate_offset(mapped, seen, 30.0) is None


def test_a_curve_moved_to_the_lattice_is_the_same_curve():
    t = np.linspace(0, 2, 300)
    curve = Curve.fit(t, np.column_stack([t, np.sin(2 * t)]), 0.1)
    moved = moved_to_lattice(curve, 0.537, 1e-6)
    assert moved.basis.origin / 0.1 == pytest.approx(round(moved.basis.origin / 0.1), abs=1e-6)
    tau = np.linspace(0.05, 1.95, 50)
    assert moved(tau + 0.537) == pytest.approx(curve(tau), abs=1e-3)


# ---- mapping


def test_a_round_room_becomes_a_circle_of_its_length(curves):
    chart = curves(resolution=[0.2, 0.1])
    chart.update(circle(), np.zeros(3))
    assert len(chart.outlines()) == 1
    line = chart.outlines()[0]
    inside = line[10:-10]  # the ends are extrapolated by up to a knot interval
    assert np.hypot(*inside.T) == pytest.approx(2.0, abs=2e-3)
    assert chart.length(0) == pytest.approx(2 * np.pi * 2.0, abs=0.2)


def test_memory_is_nine_bytes_a_control_point_and_twelve_a_curve(curves):
    chart = curves()
    chart.update(circle(), np.zeros(3))
    points = sum(len(store.control) for store in chart.stores)
    assert points > 100
    assert chart.nbytes == 9 * points + 12 * sum(len(store) for store in chart.stores)
    assert chart.statistics()["control_points"] == points


def test_points_on_one_spot_do_no_harm(curves):
    """A scan whose points all fall on one place of a curve, or within less than a knot interval."""
    chart = curves(resolution=[0.4])
    chart.update(circle(), np.zeros(3))
    before = chart.stores[0].control.copy()
    chart.update(scan(np.full(12, 2.0), angle_increment=1e-4), np.zeros(3))
    chart.update(scan(np.full(12, 0.3), angle_increment=1e-2), np.zeros(3))
    assert np.array_equal(chart.stores[0].control, before)


def test_noise_averages_out(curves):
    chart = curves(resolution=[0.1])
    rng = np.random.default_rng(3)
    errors = []
    for n in range(30):
        noisy = scan(2.0 + 0.03 * rng.standard_normal(360), angle_increment=2 * np.pi / 360)
        chart.update(noisy, np.zeros(3))
        if n in (0, 29):
            line = max(chart.outlines(), key=len)[10:-10]
            errors.append(np.sqrt(np.mean((np.hypot(*line.T) - 2.0) ** 2)))
    assert errors[1] < 0.35 * errors[0]


def test_a_wall_seen_piece_by_piece_is_one_curve(curves):
    chart = curves(resolution=[0.2])
    for x in np.arange(0.0, 6.0, 0.3):
        angles = np.arange(-60, 61) * np.deg2rad(1.0)
        chart.update(scan(1.0 / np.cos(angles), -np.deg2rad(60.0), np.deg2rad(1.0)), np.array([x, 0.0, -np.pi / 2]))
    assert len(chart.stores[0]) == 1
    assert chart.length(0) == pytest.approx(5.7 + 2 * np.tan(np.deg2rad(60.0)), abs=0.25)
    assert chart.outlines()[0][:, 1] == pytest.approx(-1.0, abs=5e-3)


def test_two_curves_are_joined_once_a_cluster_bridges_them(curves):
    chart = curves(resolution=[0.2])
    angles = np.arange(-70, 71) * np.deg2rad(1.0)
    whole = 1.0 / np.cos(angles)
    hidden = whole.copy()
    hidden[35:106] = np.nan  # something stood before the middle
    pose = np.array([0.0, 0.0, 0.3])
    chart.update(scan(hidden, -np.deg2rad(70.0), np.deg2rad(1.0)), pose)
    assert len(chart.stores[0]) == 2
    chart.update(scan(whole, -np.deg2rad(70.0), np.deg2rad(1.0)), pose)
    assert len(chart.stores[0]) == 1
    assert chart.statistics()["curves_joined"] == 1


@pytest.mark.parametrize(("scans", "joined"), [(20.0, False), (1.0, True)])
def test_a_proven_wall_is_not_bent_by_what_is_joined_to_it(scans, joined):
    """A cluster steps from a wall to a shelf 0.4 m before it; both curves go on side by side.

    Averaging their control points would draw both through the middle.
    """
    store = CurveStore(0.1)
    t = np.linspace(0.0, 3.0, 301)
    wall = Curve.fit(t, np.column_stack([t, 0.0 * t]), 0.1)
    shelf = Curve.fit(t, np.column_stack([t + 1.0, 0.0 * t + 0.4]), 0.1)
    for curve in (wall, shelf):
        curve.weights[:] = scans
    store.change({}, [wall, shelf])
    seen = np.concatenate(
        [np.column_stack([x := np.arange(0.5, 0.96, 0.03), 0.0 * x]), np.column_stack([x + 0.55, 0.0 * x + 0.4])]
    )
    points = np.column_stack([seen, np.ones(len(seen)), np.zeros((len(seen), 3))])
    chord = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(seen, axis=0).T))])
    clusters = Clusters(points, chord, np.array([0, len(seen)]))
    found = associate(store, LookupCache(store, 0.5).covering((-1.0, -1.0, 5.0, 2.0)), clusters, np.zeros(3), 0.15)
    assert found.runs[:, 2].tolist() == [0, 1]
    done = Fusion(store, 0.15, 0.1, 50.0, 8).apply(clusters, seen, found, np.zeros(len(seen), np.bool_))
    assert done.joined == joined
    if not joined:
        assert store.curve(0)(t[5:-5])[:, 1] == pytest.approx(0.0, abs=0.01)
        assert store.curve(1)(t[5:-5])[:, 1] == pytest.approx(0.4, abs=0.01)


def test_a_copy_of_a_piece_of_a_proven_wall_is_dropped():
    """A wall round a corner, and a piece of it on a parameter that runs faster: joined, it would bend the wall."""
    store = CurveStore(0.1)
    t = np.linspace(0.0, 4.0, 401)
    corner = np.column_stack([np.minimum(t, 2.0), np.maximum(t - 2.0, 0.0)])
    wall = Curve.fit(t, corner, 0.1, smoothness=1e-4)
    copy = Curve.fit(1.5 * (t[100:301] - 1.0), corner[100:301] + 0.02, 0.1, smoothness=1e-4)
    wall.weights[:], copy.weights[:] = 20.0, 4.0
    store.change({}, [wall, copy])
    work = Fusion(store, 0.15, 0.1, 50.0, 8)
    work._drop_copy(1, store.curve(1), 0, store.curve(0))
    assert work._gone == {1}
    number, shift = work._current(1)
    assert number == 0
    assert shift == pytest.approx(0.5, abs=0.1)  # the middle of the copy is the corner: 2.0 of the wall, 1.5 of its own
    apart = Fusion(store, 0.15, 0.1, 50.0, 8)
    aside = Curve(store.curve(1).control + 0.3, store.curve(1).basis, weights=store.curve(1).weights)
    apart._drop_copy(1, aside, 0, store.curve(0))
    assert not apart._gone


def test_both_sides_of_a_thin_wall_stay_apart(curves):
    chart = curves(resolution=[0.1])
    angles = np.arange(-60, 61) * np.deg2rad(1.0)
    ranges = 1.0 / np.cos(angles)
    for _ in range(3):
        chart.update(scan(ranges, -np.deg2rad(60.0), np.deg2rad(1.0)), np.array([0.0, 0.0, 0.0]))
        chart.update(scan(ranges, -np.deg2rad(60.0), np.deg2rad(1.0)), np.array([2.08, 0.0, np.pi]))
    assert len(chart.stores[0]) == 2
    sides = sorted(float(line[:, 0].mean()) for line in chart.outlines())
    assert sides == pytest.approx([1.0, 1.08], abs=5e-3)


def test_what_scans_look_through_is_removed(curves):
    chart = curves(resolution=[0.1])
    box = np.full(360, 3.0)
    box[:40] = 1.0
    for _ in range(3):
        chart.update(scan(box, angle_increment=np.deg2rad(1.0)), np.zeros(3))
    here = np.array([[np.cos(0.35), np.sin(0.35)]])
    assert chart.occupancy(here)[0] > 0.5
    for _ in range(12):
        chart.update(circle(3.0), np.zeros(3))
    assert chart.occupancy(here)[0] <= 0.0
    assert chart.occupancy(3.0 * here)[0] > 0.5
    assert chart.statistics()["stale_control_points"] > 0


# ---- alignment


def mapped_room(curves, **options):
    chart = curves(options=options, resolution=[0.4, 0.2, 0.1])
    for number, pose in enumerate(ROOM.poses(12)):
        chart.update(ROOM.scan(pose, scan_id=number), pose)
    return chart


@pytest.mark.parametrize("sigma_along", [0.0, 0.2])
def test_the_least_cost_is_at_the_true_pose(curves, sigma_along):
    chart = mapped_room(curves, sigma_along=sigma_along)
    truth = np.array([0.3, -0.2, 0.5])
    pose = truth + np.array([0.06, -0.05, 0.03])
    alignment = chart.alignment(ROOM.scan(truth, scan_id=99), pose)
    for _ in range(15):
        terms = alignment.normal_equations(pose, 2, "cauchy", 6.5)
        pose = pose - np.linalg.solve(terms.H, terms.g)
    assert pose == pytest.approx(truth, abs=4e-3)


def test_with_offsets_inside_the_gradient_is_that_of_the_cost(curves):
    """The offsets are eliminated exactly: central differences of the cost, offsets solved anew at each pose."""
    chart = mapped_room(curves, sigma_along=0.2, normals=False)
    pose = np.array([0.34, -0.23, 0.52])
    alignment = chart.alignment(ROOM.scan(np.array([0.3, -0.2, 0.5]), scan_id=99), pose)
    for level in range(3):
        for loss in ("none", "cauchy", "huber"):
            g = alignment.normal_equations(pose, level, loss, 6.5).g
            pairs = [alignment.costs(np.array([pose + e, pose - e]), level, loss, 6.5) for e in np.eye(3) * 1e-4]
            numeric = np.array([(a - b) / 4e-4 for a, b in pairs])
            assert g == pytest.approx(numeric, rel=0.02, abs=0.01 * float(np.linalg.norm(numeric)))


def test_tracks_say_which_stretch_lies_where(curves):
    """A round room seen again after a turn: the offset is the arc that it turned."""
    chart = curves(resolution=[0.1])
    half = np.full(180, 2.0)
    chart.update(scan(half, angle_increment=np.deg2rad(1.0)), np.zeros(3))
    pose = np.array([0.0, 0.0, np.deg2rad(30.0)])
    tracks = chart.alignment(scan(half, angle_increment=np.deg2rad(1.0)), pose).tracks(pose, 0)
    assert len(tracks) == 1
    assert tracks[0].offset == pytest.approx(np.deg2rad(30.0) * 2.0, abs=0.02)
    assert tracks[0].overlap == pytest.approx(np.deg2rad(149.0) * 2.0, abs=0.1)


@pytest.mark.parametrize(("clutter", "share"), [(0, 1.0), (60, 1.0), (180, 60 / 120)])
def test_beams_that_no_curve_can_hold_do_not_count_but_half_of_them_always_do(curves, clutter, share):
    """Sixty beams lie on an arc, the rest end one by one, near and far: twigs, chair legs."""
    ranges = np.concatenate([np.full(60, 2.0), np.where(np.arange(clutter) % 2, 4.0, 6.0)])
    chart = curves(resolution=[0.1])
    chart.update(scan(ranges), np.zeros(3))
    alignment = chart.alignment(scan(ranges), np.zeros(3))
    assert alignment.inliers(np.zeros(3), 0) == pytest.approx(share)
    terms = alignment.normal_equations(np.zeros(3), 0)
    assert (terms.n_used, terms.n_total) == (60, max(60, (60 + clutter) // 2))


def test_a_scan_of_another_place_is_not_explained(curves):
    chart = mapped_room(curves)
    pose = np.array([0.3, -0.2, 0.5])
    alignment = chart.alignment(scan(np.full(360, 1.6), angle_increment=2 * np.pi / 360), pose)
    terms = alignment.normal_equations(pose, 2)
    assert alignment.inliers(pose, 1) < 0.1
    assert terms.n_used > 0.4 * terms.n_total, "in front of walls it contradicts what is known to be free"


# ---- questions


def test_a_planner_gets_distances_lengths_and_hulls(curves):
    chart = mapped_room(curves)
    points = np.array([[0.6, -0.4], [3.6, -0.4], [0.6, 1.1], [4.4, -0.4]])
    near = chart.nearest(points)
    assert near.distance == pytest.approx([-2.5, -0.5, -1.0, 0.3], abs=0.02)
    assert near.point[1] == pytest.approx([4.1, -0.4], abs=0.02)
    assert np.all(np.isinf(chart.nearest(points, reach=0.1).distance))
    total = sum(chart.length(k) for k in range(len(chart.stores[-1])))
    assert total == pytest.approx(24.0, abs=1.0)
    hulls = chart.hulls()
    assert len(hulls) == sum(len(store) and int((store.table[:, 1] - 3).sum()) for store in chart.stores[-1:])
    for line in chart.outlines():
        for p in line[::7]:
            assert any(contains(hull, p) for hull in hulls)


def contains(hull, p):
    if len(hull) < 3:
        return False
    edges = np.roll(hull, -1, axis=0) - hull
    to = p - hull
    return bool(np.all(edges[:, 0] * to[:, 1] - edges[:, 1] * to[:, 0] >= -1e-5))


def test_hulls_are_convex_and_hold_their_points():
    rng = np.random.default_rng(4)
    for _ in range(50):
        points = rng.standard_normal((4, 2))
        hull = convex(points)
        assert all(contains(hull, p) for p in points)
    assert len(convex(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]))) == 2


def test_a_store_finds_its_curves_after_changes():
    store = CurveStore(0.5)
    lines = [Curve(np.column_stack([np.arange(6.0), np.full(6, y)]), step=0.5) for y in range(10)]
    store.change({}, lines)
    store.change({2: [], 5: [lines[5], lines[2]]}, [lines[3]])
    kept = [0, 1, 3, 4, 5, 2, 6, 7, 8, 9, 3]
    assert [store.curve(k).control[0, 1] for k in range(len(store))] == kept
    assert [kept[k] for k in store.near(0.0, 2.5, 5.0, 4.5)] == [3, 4, 3]
    assert store.table[:, 0].tolist() == list(range(0, 6 * len(kept), 6))
    assert math.isclose(store.curve(0).basis.origin, 0.0)
