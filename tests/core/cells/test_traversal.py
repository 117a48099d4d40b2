import math

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from knotwork.core.cells.traversal import cells_along, claim
from knotwork.core.splines import TiledArray
from knotwork.core.splines.tiles import SIDE

COORDINATE = st.floats(-20, 20)


def crossed(x, y, ux, uy, start, end, step, slack):
    """Cells whose square, shrunk by `slack` [cells], meets the segment: the slab method, cell by cell."""
    ends = np.array([[x + d * ux, y + d * uy] for d in (start, end)]) / step
    low, high = np.floor(ends.min(axis=0)).astype(int) - 1, np.floor(ends.max(axis=0)).astype(int) + 1
    found = set()
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            t0, t1 = start / step, end / step
            for origin, direction, cell in ((x / step, ux, i), (y / step, uy, j)):
                a, b = cell + slack - origin, cell + 1 - slack - origin
                if direction == 0:
                    t0, t1 = (t0, t1) if a <= 0 <= b else (1.0, 0.0)
                else:
                    t0, t1 = max(t0, min(a / direction, b / direction)), min(t1, max(a / direction, b / direction))
            if t0 <= t1:
                found.add((i, j))
    return found


@given(COORDINATE, COORDINATE, st.floats(-4, 4), st.floats(0, 1), st.floats(0, 3), st.sampled_from([0.05, 0.3, 1.0]))
@example(0.0, 0.0, 0.0, 0.0, 2.0, 0.5)  # along a border
@example(-1.0, 1.0, math.pi / 4, 0.0, 2.0, 0.5)  # through corners
@example(3.0, 3.0, math.pi, 0.2, 0.0, 0.3)  # of no length
def test_a_ray_visits_exactly_the_cells_it_crosses(x, y, angle, start, length, step):
    """Every cell it surely crosses, none that it surely misses, in a chain of neighbours."""
    ux, uy = math.cos(angle), math.sin(angle)
    end = start + length
    visited = cells_along(x, y, ux, uy, start, end, step)
    cells = set(map(tuple, visited.tolist()))
    assert crossed(x, y, ux, uy, start, end, step, 1e-6) <= cells
    assert cells <= crossed(x, y, ux, uy, start, end, step, -1e-6)
    assert len(cells) == len(visited)
    assert np.all(np.abs(np.diff(visited, axis=0)).sum(axis=1) == 1)


def test_all_tiles_under_the_rays_are_claimed_and_no_other():
    rng = np.random.default_rng(3)
    step, nearest, over, free = 0.05, 0.1, 0.2, 5.0
    rays = np.empty((40, 6))
    angles = rng.uniform(-math.pi, math.pi, 40)
    rays[:, :2] = rng.uniform(-0.2, 0.2, (40, 2))
    rays[:, 2], rays[:, 3] = np.cos(angles), np.sin(angles)
    rays[:, 4] = rng.uniform(0.5, 12.0, 40)
    rays[:, 5] = rng.random(40) < 0.7
    pose = np.array([30.0, -40.0, 0.7])
    cells = TiledArray(np.int8)
    claim(cells, step, rays, pose, nearest, over, free)
    expected = set()
    c, s = math.cos(0.7), math.sin(0.7)
    for x, y, ux, uy, length, ended in rays.tolist():
        end = length + over if ended else min(length, free)
        d = np.linspace(nearest, end, 4000)
        px = 30.0 + c * x - s * y + d * (c * ux - s * uy)
        py = -40.0 + s * x + c * y + d * (s * ux + c * uy)
        side = step * SIDE
        tiles = np.floor(np.column_stack([px, py]) / side).astype(int)
        expected |= set(map(tuple, tiles.tolist()))
    where, _ = cells.claimed()
    claimed = set(map(tuple, where.tolist()))
    assert expected <= claimed
    assert len(claimed - expected) <= 2  # corners that samples miss
