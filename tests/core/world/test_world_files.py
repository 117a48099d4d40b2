"""Reading worlds: what the keys mean, where mistakes are named, and the worlds that ship."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knotwork.core.errors import InputError
from knotwork.core.world.files import load_world, parse_world, shipped_worlds
from knotwork.core.world.raycast import RayCaster


def test_every_key():
    world = parse_world(
        """
name: all
about: one of each
start: [1, 2, 1e-1]
segments: [[0, 0, 1, 0]]
polylines: [[[0, 0], [1, 0], [1, 1]]]
polygons: [[[0, 0], [1, 0], [1, 1]]]
boxes: [[0, 0, 2, 3]]
circles: [[5, 5, 0.5]]
arcs: [[6, 5, 0.5, 0, -1.5]]
paths: {tour: [[0, 0], [1, 0]]}
"""
    )
    assert (world.name, world.about, world.start) == ("all", "one of each", (1.0, 2.0, 0.1))
    assert world.segments.shape == (1 + 4 + 2 + 3, 4)
    np.testing.assert_allclose(world.arcs, [[5, 5, 0.5, 0, 2 * np.pi], [6, 5, 0.5, 0, -1.5]])
    np.testing.assert_allclose(world.paths["tour"], [[0, 0], [1, 0]])
    assert world.bounds() == (0, 0, 6.5, 5.5)


@pytest.mark.parametrize(
    ("text", "where", "says"),
    [
        ("boxes: [[0, 0, 1]]", "w.yaml:1:9", "4 numbers, found 3"),
        ("boxes:\n  - [0, 0, 1, one]", "w.yaml:2:15", "'one' is not a number"),
        ("boxes:\n  - [0, 0, .nan, 1]", "w.yaml:2:12", "not a number"),
        ("boxes:\n  - [0, 0, 0, 1]", "w.yaml:2:5", "no area"),
        ("boxes:\n  - [0, 0, 1e300, 1]", "w.yaml:2:12", "at most 1000000 m"),
        ("segments:\n  - [1, 2, 1, 2]", "w.yaml:2:5", "no length"),
        ("circles: [[0, 0, -1]]", "w.yaml:1:11", "radius is -1.0 m"),
        ("arcs: [[0, 0, 1, 0, 7]]", "w.yaml:1:8", "sweep"),
        ("polygon: [[[0, 0], [1, 0], [1, 1]]]", "w.yaml:1:1", "did you mean 'polygons'"),
        ("polygons: [[[0, 0], [1, 0]]]", "w.yaml:1:12", "expected at least 3"),
        ("polygons: [[[0, 0], [1, 0], [1, 1], [0, 0]]]", "w.yaml:1:37", "closed by itself"),
        ("polylines: [[[0, 0], [0, 0]]]", "w.yaml:1:22", "repeats the one before"),
        ("boxes: [[0, 0, 1, 1]]\nboxes: []", "w.yaml:2:1", "given twice"),
        ("boxes: {a: 1}", "w.yaml:1:8", "expected a list"),
        ("- 1", "w.yaml:1:1", "key: value"),
        ("name: x", "w.yaml:1:1", "at least one obstacle"),
        ("", "w.yaml", "empty"),
        ("boxes: [[0, 0, 1, 1]\nname: x", "w.yaml:2:1", "not YAML"),
        ("boxes: [[0, 0, 1, 1]]\npaths: {a: [[0, 0]]}", "w.yaml:2:12", "path 'a' has 1 points"),
        ("boxes: [[0, 0, 1, 1]]\nstart: [0, 0]", "w.yaml:2:8", "3 numbers"),
        ("boxes: " + "[" * 5000, "w.yaml", "not YAML"),
    ],
)
def test_mistakes_are_named_with_their_place(text, where, says):
    with pytest.raises(InputError) as caught:
        parse_world(text, "w.yaml")
    assert caught.value.where == where
    assert says in str(caught.value)


@settings(max_examples=300, deadline=None)
@given(st.text(alphabet="[]{},:-. \n0123456789abeoxsntcirlpyg&*!|\"'#\t\x00", max_size=80))
def test_no_text_ends_in_another_error(text):
    for candidate in (text, "boxes: " + text, "paths: {a: [" + text):
        try:
            parse_world(candidate)
        except InputError:
            continue


number = st.one_of(st.integers(-9, 9), st.floats(-1e6, 1e6, allow_subnormal=True), st.just(1e-12))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.lists(number, min_size=4, max_size=4), max_size=4),
    st.lists(st.lists(number, min_size=5, max_size=5), max_size=3),
    st.lists(number, min_size=3, max_size=3),
)
def test_any_world_that_is_accepted_can_be_cast_in(segments, arcs, ray):
    try:
        world = parse_world(f"segments: {segments}\narcs: {arcs}")
    except InputError:
        return
    caster = RayCaster(world)
    direction = np.array([[np.cos(ray[2]), np.sin(ray[2])]])
    assert caster.cast(np.array([ray[:2]], dtype=float), direction)[0] >= 0.0
    assert caster.clearance(ray[0], ray[1]) >= 0.0


def test_no_such_world(tmp_path):
    with pytest.raises(InputError, match="did you mean 'apartment'"):
        load_world("apartmant")
    with pytest.raises(InputError, match="No such file"):
        load_world(str(tmp_path / "none.yaml"))
    with pytest.raises(InputError, match="cannot read"):
        load_world(f"{tmp_path}/")
    (tmp_path / "latin.yaml").write_bytes(b"name: \xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        load_world(str(tmp_path / "latin.yaml"))
    (tmp_path / "mine.yaml").write_text("circles: [[0, 0, 3]]")
    assert load_world(str(tmp_path / "mine.yaml")).name == "mine"


def test_the_shipped_worlds_are_these():
    assert shipped_worlds() == ["apartment", "arena", "corridor-300m", "gallery", "room"]


@pytest.mark.parametrize("name", shipped_worlds())
def test_a_burger_can_drive_the_tour(name):
    """Its disc keeps 10 cm from every obstacle all along."""
    world = load_world(name)
    assert world.name == name
    tour = world.paths["tour"]
    np.testing.assert_allclose(tour[0], world.start[:2])
    fine = np.vstack([np.linspace(a, b, 100) for a, b in pairwise(tour)])
    assert RayCaster(world).clearances(fine).min() > 0.105 + 0.10


def test_the_apartment_s_tour_visits_every_room():
    tour = load_world("apartment").paths["tour"]
    rooms = {
        "kitchen": (0, 0, 3.5, 3.2),
        "living room": (3.7, 0, 7.9, 3.2),
        "study": (8.1, 0, 11, 3.2),
        "west bedroom": (0, 5, 4.1, 8),
        "bath": (4.3, 5, 6.5, 8),
        "east bedroom": (6.7, 5, 11, 8),
    }
    for x0, y0, x1, y1 in rooms.values():
        assert np.any((tour > (x0, y0)).all(axis=1) & (tour < (x1, y1)).all(axis=1))
    assert 40 < np.hypot(*np.diff(tour, axis=0).T).sum() < 60
