"""Ray casting and clearance against closed forms and an independent NumPy implementation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knotwork.core.world.raycast import RayCaster
from knotwork.core.world.scene import World, box, polyline


def unit(angles):
    return np.column_stack((np.cos(angles), np.sin(angles)))


def brute_force(world, origins, directions):
    """Line by line: a linear system for each segment, a polynomial and arctan2 for each arc."""
    out = np.full(len(origins), np.inf)
    for k, (o, d) in enumerate(zip(origins, directions, strict=True)):
        for x1, y1, x2, y2 in world.segments:
            a, b = np.array((x1, y1)), np.array((x2, y2))
            t, u = np.linalg.solve(np.column_stack((d, a - b)), a - o)
            if t >= 0 and 0 <= u <= 1:
                out[k] = min(out[k], t)
        for cx, cy, r, first, sweep in world.arcs:
            f = o - (cx, cy)
            for root in np.roots((d @ d, 2 * f @ d, f @ f - r * r)):
                if abs(root.imag) > 1e-9 or root.real < 0:
                    continue
                p = f + root.real * d
                turned = (np.arctan2(p[1], p[0]) - first) * np.sign(sweep) % (2 * np.pi)
                if turned <= abs(sweep):
                    out[k] = min(out[k], root.real)
    return out


def random_world(rng, n_segments, n_arcs, size=6.0):
    starts = rng.uniform(-size, size, (n_segments, 2))
    arcs = np.column_stack(
        (
            rng.uniform(-size, size, (n_arcs, 2)),
            rng.uniform(0.05, 2.0, n_arcs),
            rng.uniform(-7, 7, n_arcs),
            rng.uniform(-2 * np.pi, 2 * np.pi, n_arcs),
        )
    )
    segments = np.hstack((starts, starts + rng.normal(0, 1.5, (n_segments, 2))))
    return World("random", segments, arcs)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.integers(0, 8))
def test_agrees_with_brute_force(seed, n_segments, n_arcs):
    rng = np.random.default_rng(seed)
    world = random_world(rng, n_segments, n_arcs)
    origins = rng.uniform(-9, 9, (40, 2))  # inside and outside of what is indexed
    directions = unit(rng.uniform(-np.pi, np.pi, 40))
    expected = brute_force(world, origins, directions)
    caster = RayCaster(world)
    np.testing.assert_allclose(caster.cast(origins, directions), expected, rtol=1e-7, atol=1e-7)
    near = np.where(expected <= 2.0, expected, np.inf)
    np.testing.assert_allclose(caster.cast(origins, directions, 2.0), near, rtol=1e-7, atol=1e-7)


def test_square_room_in_closed_form():
    caster = RayCaster(World("square", box(-2, -2, 2, 2)))
    angles = np.deg2rad(np.arange(0, 360, 0.25))  # hits axes and corners exactly
    at = np.array((0.4, -0.7))
    d = unit(angles)
    with np.errstate(divide="ignore"):
        walls = np.where(np.abs(d) > 1e-15, (np.sign(d) * 2 - at) / d, np.inf)
    got = caster.cast(np.tile(at, (len(d), 1)), d)
    np.testing.assert_allclose(got, walls.min(axis=1), rtol=1e-12)


def test_circle_from_inside_and_outside():
    caster = RayCaster(World("circle", np.empty((0, 4)), np.array([[1.0, 2.0, 1.5, 0.3, 2 * np.pi]])))
    angles = np.linspace(0, 2 * np.pi, 721)
    d = unit(angles)
    at = np.array((1.6, 2.3))
    f = at - (1.0, 2.0)
    expected = -d @ f + np.sqrt((d @ f) ** 2 - f @ f + 1.5**2)
    np.testing.assert_allclose(caster.cast(np.tile(at, (len(d), 1)), d), expected, rtol=1e-12)
    outside = caster.cast(np.array([[-3.0, 2.0], [-3.0, 4.0], [-3.0, 2.0]]), unit(np.array([0.0, 0.0, 1.0])))
    np.testing.assert_allclose(outside, [2.5, np.inf, np.inf])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_half_circle_is_open_on_the_other_side(sign):
    """The upper half, drawn in either sense; rays from below pass its mouth and meet it from inside."""
    arc = np.array([[0.0, 0.0, 1.0, 0.0 if sign > 0 else np.pi, sign * np.pi]])
    caster = RayCaster(World("half", np.empty((0, 4)), arc))
    up, down = unit(np.array([np.pi / 2])), unit(np.array([-np.pi / 2]))
    assert caster.cast(np.array([[0.6, -2.0]]), up)[0] == pytest.approx(2.8)
    assert caster.cast(np.array([[0.6, 3.0]]), down)[0] == pytest.approx(2.2)
    assert caster.cast(np.array([[0.6, 0.1]]), down)[0] == np.inf
    assert caster.clearance(0.0, 0.2) == pytest.approx(0.8)
    assert caster.clearance(1.3, -0.4) == pytest.approx(0.5)  # to the end (1, 0)


def test_no_ray_escapes_through_a_corner_or_a_joint():
    """Rays aimed exactly at vertices, also where three straight pieces continue one line."""
    walls = np.array([(-1.3, -0.7), (0.1, -0.7), (0.9, -0.7), (2.1, -0.7), (2.1, 1.9), (0.3, 2.2), (-1.3, 1.1)])
    caster = RayCaster(World("polygon", polyline(walls, closed=True)))
    rng = np.random.default_rng(3)
    for origin in rng.uniform((-1.0, -0.5), (1.8, 1.0), (200, 2)):
        aim = walls - origin
        distance = np.hypot(*aim.T)
        got = caster.cast(np.tile(origin, (len(walls), 1)), aim / distance[:, None])
        np.testing.assert_allclose(got, distance, rtol=1e-9)


@pytest.mark.parametrize("offset", [0.0, 10_000.0])
def test_long_corridor(offset):
    """300 m long: far ends, flat angles, also 10 km from the origin."""
    caster = RayCaster(World("corridor", box(offset, offset - 1, offset + 300, offset + 1)))
    angles = np.array([0.0, np.pi, 0.004, -0.02, np.pi - 0.3])
    at = np.tile((offset + 5.0, offset), (len(angles), 1))
    expected = [295.0, 5.0, 1 / np.sin(0.004), 1 / np.sin(0.02), 1 / np.sin(0.3)]
    np.testing.assert_allclose(caster.cast(at, unit(angles)), expected, rtol=1e-9)


def test_a_single_axis_parallel_wall_has_a_flat_index():
    caster = RayCaster(World("wall", np.array([[0.0, 1.0, 5.0, 1.0]])))
    got = caster.cast(np.array([[2.0, 0.0], [2.0, 3.0], [6.0, 0.0]]), unit(np.array([1.0, -1.0, 1.0]) * np.pi / 2))
    np.testing.assert_allclose(got, [1.0, 2.0, np.inf])


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_clearance_is_the_distance_to_the_nearest_sample(seed):
    rng = np.random.default_rng(seed)
    world = random_world(rng, 5, 4)
    share = np.linspace(0, 1, 4001)[:, None, None]
    a, b = world.segments[:, :2], world.segments[:, 2:]
    cx, cy, r, first, sweep = world.arcs.T
    angle = first + np.linspace(0, 1, 4001)[:, None] * sweep
    samples = np.vstack(
        (
            (a + share * (b - a)).reshape(-1, 2),
            np.column_stack(((cx + r * np.cos(angle)).ravel(), (cy + r * np.sin(angle)).ravel())),
        )
    )
    spacing = max(np.hypot(*(b - a).T).max(), (r * abs(sweep)).max()) / 4000
    caster = RayCaster(world)
    points = rng.uniform(-7, 7, (20, 2))
    for point, clearance in zip(points, caster.clearances(points), strict=True):
        nearest = np.hypot(*(samples - point).T).min()
        assert nearest - spacing <= clearance <= nearest + 1e-12
        assert caster.collides(*point, nearest + 1e-9)
        assert not caster.collides(*point, nearest - spacing - 1e-9)
