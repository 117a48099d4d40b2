"""The tiled array against a dense one and a dictionary."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knotwork.core.errors import KnotworkError
from knotwork.core.splines import TiledArray, tiles

BOXES = st.tuples(st.integers(-200, 200), st.integers(-200, 200), st.integers(1, 80), st.integers(1, 80))


@settings(max_examples=40, deadline=None)
@given(st.lists(BOXES, min_size=1, max_size=8), st.floats(-3, 3, width=32), st.sampled_from(["f4", "f8"]))
def test_growth_in_any_direction_keeps_every_element(boxes, fill, dtype):
    tiled = TiledArray(dtype, fill)
    dense = np.full((600, 600), fill, dtype)
    for number, (i, j, n, m) in enumerate(boxes):
        values = np.arange(n * m, dtype=dtype).reshape(n, m) + number
        tiled.write_block(i, j, values)
        dense[i + 250 : i + 250 + n, j + 250 : j + 250 + m] = values
    for same in (tiled, tiled.copy(), TiledArray.from_claimed(*tiled.claimed(), fill)):
        np.testing.assert_array_equal(same.block(-250, -250, 350, 350), dense)
    i, j = boxes[0][:2]
    assert tiles.read(*tiled.arrays(), i, j) == dense[i + 250, j + 250]
    assert tiles.read(*tiled.arrays(), 10**9, -(10**12)) == np.dtype(dtype).type(fill)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(-500, 500), st.integers(-500, 500)), min_size=1, max_size=30), st.integers(2, 6))
def test_reserved_patches_are_backed_by_their_own_tiles(starts, width):
    tiled = TiledArray()
    tiled.reserve_patches(np.array(starts), width)
    slots = tiled.directory[tiled.directory > 0]
    assert len(set(slots.tolist())) == len(slots) == tiled.used - 1
    assert slots.max() < len(tiled.pool)
    for i, j in starts:
        for a, b in ((0, 0), (width - 1, 0), (0, width - 1), (width - 1, width - 1)):
            assert tiles.slot_of(tiled.directory, tiled.oi, tiled.oj, i + a, j + b) > 0


def test_memory_follows_the_touched_area():
    empty, small = TiledArray(), TiledArray()
    small.reserve_box(0, 0, 30, 30)
    assert empty.nbytes <= 20_000
    assert small.nbytes <= 100_000
    # A diagonal corridor: 300 m of 3 m at 5 cm; its bounding box is 72 MB of float32.
    corridor = TiledArray()
    for k in range(0, 4240, 10):
        corridor.reserve_box(k, k, k + 42, k + 42)
    touched = 300 / 0.05 * 3 / 0.05 * 4
    assert corridor.nbytes < 4 * touched
    # A straight one, grown in the negative direction.
    straight = TiledArray()
    for k in range(0, -6000, -20):
        straight.reserve_box(k, 0, k + 60, 60)
    assert straight.nbytes < 2.7 * touched


def test_growing_leaves_a_held_view_whole():
    tiled = TiledArray()
    tiled.write_block(0, 0, np.ones((20, 20), np.float32))
    held = tiled.pool[1]
    tiled.reserve_box(-500, -500, 500, 500)
    assert held[:20, :20].sum() == 400
    assert tiled.block(0, 0, 20, 20).sum() == 400


def test_absurd_extent_is_refused_and_changes_nothing():
    tiled = TiledArray()
    tiled.reserve_box(0, 0, 10, 10)
    with pytest.raises(KnotworkError, match="wild pose"):
        tiled.reserve_box(10**9, 10**9, 10**9 + 4, 10**9 + 4)
    assert tiled.bounds() == (0, 0, tiles.SIDE, tiles.SIDE)
