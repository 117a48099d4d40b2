import base64
from io import BytesIO

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from knotwork.core.live.tiles import SIDE, Tiles
from knotwork.core.messages import Grid


def grid(cells, i=0, j=0, resolution=0.05, yaw=0.0):
    origin = (i * resolution, j * resolution, yaw)
    return Grid(stamp=0, cells=np.asarray(cells, np.int8), resolution=resolution, origin=origin)


def cells_of(png: str) -> np.ndarray:
    """What a page sees: -1 where transparent, else percent from the grey; rows upwards."""
    picture = np.asarray(Image.open(BytesIO(base64.b64decode(png))).convert("RGBA"))[::-1].astype(float)
    percent = np.rint((255 - picture[..., 0]) / 2.3).astype(int)
    return np.where(picture[..., 3] == 0, -1, percent)


class Page:
    def __init__(self):
        self.tiles = {}

    def take(self, told):
        if told is None:
            return
        if told["fresh"]:
            self.tiles.clear()
        for i, j, png in told["tiles"]:
            self.tiles[i, j] = cells_of(png)

    def cell(self, i, j):
        tile = self.tiles.get((i // SIDE, j // SIDE))
        return -1 if tile is None else tile[j % SIDE, i % SIDE]


@settings(max_examples=15, deadline=None)
@given(st.lists(st.tuples(st.integers(-200, 200), st.integers(-200, 200), st.integers(0, 2**31)), max_size=4))
def test_a_page_that_takes_changes_sees_the_last_grid(grids):
    tiles, page = Tiles(), Page()
    last = None
    for i, j, seed in grids:
        rng = np.random.default_rng(seed)
        last = rng.integers(-1, 101, (rng.integers(1, 200), rng.integers(1, 200))), i, j
        tiles.update(grid(*last))
        page.take(tiles.changes())
    if last is None:
        return
    cells, i, j = last
    rng = np.random.default_rng(0)
    for _ in range(200):
        row, column = rng.integers(0, cells.shape[0]), rng.integers(0, cells.shape[1])
        assert page.cell(i + column, j + row) == cells[row, column]
    assert page.cell(i - 1, j) == page.cell(i + cells.shape[1], j) == -1
    fresh = Page()
    fresh.take(tiles.everything())
    assert fresh.tiles.keys() == page.tiles.keys()
    assert all(np.array_equal(fresh.tiles[key], page.tiles[key]) for key in page.tiles)


def test_only_changed_tiles_travel():
    tiles = Tiles()
    cells = np.full((3 * SIDE, 3 * SIDE), 10, np.int8)
    tiles.update(grid(cells))
    assert len(tiles.changes()["tiles"]) == 9
    tiles.update(grid(cells))
    assert tiles.changes() is None
    cells = cells.copy()
    cells[SIDE + 5, 2 * SIDE + 7] = 90
    tiles.update(grid(cells))
    told = tiles.changes()
    assert not told["fresh"]
    assert [tile[:2] for tile in told["tiles"]] == [[2, 1]]


def test_another_resolution_begins_anew():
    tiles = Tiles()
    tiles.update(grid([[1]]))
    tiles.changes()
    tiles.update(grid([[1]], resolution=0.1))
    assert tiles.changes()["fresh"]


def test_a_turned_grid_keeps_its_corner():
    tiles = Tiles()
    tiles.update(grid([[1]], 3, 4, yaw=0.5))
    told = tiles.changes()
    assert told["corner"] == (3 * 0.05, 4 * 0.05, 0.5)
    assert told["tiles"][0][:2] == [0, 0]
