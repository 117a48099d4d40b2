import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from knotwork.core.depth.tracks import Tracks, usable


@settings(deadline=None, max_examples=100)
@given(st.lists(st.lists(st.integers(-3, 8), max_size=6, unique=True), max_size=12))
def test_rows_follow_their_features_whatever_comes_and_goes(frames):
    tracks = Tracks(2.0, age=(), mark=(2,))
    model = {}  # id to (age, frames unseen)
    for ids in frames:
        array = np.array(ids, dtype=np.int64)
        before = set(model)
        rows, seen, fresh = tracks.match(array, 1.0)
        for name in list(model):
            age, unseen = model[name]
            model[name] = (age, 0 if name in ids else unseen + 1)
            if model[name][1] > 2:
                del model[name]
        assert len(tracks["age"]) == len(tracks["mark"]) == len(seen) == tracks.ids.size
        np.testing.assert_array_equal(tracks.ids[rows], array)
        assert set(tracks.ids[fresh].tolist()) == set(ids) - before
        assert {tracks.ids[r] for r in np.flatnonzero(seen)} == set(ids) & before
        tracks["age"][rows] += 1
        for name in ids:
            model[name] = (model.get(name, (0, 0))[0] + 1, 0)
        assert dict(zip(tracks.ids.tolist(), tracks["age"].tolist(), strict=True)) == {
            n: a for n, (a, _) in model.items()
        }


def test_nan_and_repeated_ids_cannot_be_used():
    ids = np.array([3, 1, 3, 2, 1])
    points = np.array([(0, 0), (np.nan, 0), (1, 1), (2, np.inf), (4, 4)], dtype=float)
    np.testing.assert_array_equal(usable(ids, points), (True, False, False, False, True))
    assert usable(np.empty(0, dtype=np.int64), np.empty((0, 2))).size == 0
