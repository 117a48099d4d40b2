import gzip
import lzma
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from knotwork.core.errors import InputError
from knotwork.core.evaluation.tum import StampedPoses, read_tum, tum_line, write_tum

COORDINATE = st.floats(-1e4, 1e4)
NO_FIXTURE_CHECK = [HealthCheck.function_scoped_fixture]


@settings(suppress_health_check=NO_FIXTURE_CHECK, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, 2**61), st.tuples(COORDINATE, COORDINATE, st.floats(-3.14, 3.14))),
        min_size=1,
        max_size=8,
    )
)
def test_a_trajectory_survives_its_file(tmp_path, rows):
    stamps, poses = zip(*rows, strict=True)
    path = tmp_path / "t.tum"
    write_tum(path, stamps, poses)
    again = read_tum(path)
    assert again.stamps.tolist() == list(stamps)
    assert np.allclose(again.poses[:, :2], np.array(poses)[:, :2], rtol=0, atol=1e-6)
    assert np.allclose(again.poses[:, 2], np.array(poses)[:, 2], rtol=0, atol=1e-8)


def test_a_line_has_the_stamp_of_the_log_and_a_unit_quaternion():
    fields = tum_line(976052857337284000, (1.5, -2.25, 2.0)).split()
    assert fields[:6] == ["976052857.337284", "1.500000", "-2.250000", "0", "0", "0"]
    x, y, z, w = Rotation.from_euler("z", 2.0).as_quat()
    assert [float(field) for field in fields[4:]] == pytest.approx([x, y, z, w], abs=1e-9)


def test_yaw_of_a_tilted_and_unnormalised_quaternion(tmp_path):
    quaternion = 3.0 * Rotation.from_euler("ZYX", (2.5, 0.2, -0.3)).as_quat()
    path = tmp_path / "t.tum"
    path.write_text("1 2 3 4 " + " ".join(map(str, quaternion)))
    assert read_tum(path).poses[0] == pytest.approx((2, 3, 2.5))


@pytest.mark.parametrize("pack", [bytes, gzip.compress, lzma.compress])
def test_packed_files_and_files_of_four_columns(tmp_path, pack):
    path = tmp_path / "t.txt"
    path.write_bytes(pack(b"# stamp x y yaw\n10.000001 1 2 3\n\n9.5 4 5 -3\n"))
    poses = read_tum(path)
    assert poses.stamps.tolist() == [10_000_001_000, 9_500_000_000]
    assert poses.poses.tolist() == [[1, 2, 3], [4, 5, -3]]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "no line"),
        (b"# nothing\n", "no line"),
        (b"1 2 3\n", "t.tum:1: found 3 columns"),
        (b"1 2 3 4\n1 2 3 4 5 6 7 8\n", "t.tum:2: found 8 columns"),
        (b"1 2 3 x\n", "t.tum:1: a field is not a number"),
        (b"now 2 3 4\n", "t.tum:1: a field is not a number"),
        (b"1 2 nan 4\n", "t.tum:1: a number is not finite"),
        (b"1 2 1e300 4\n", "out of range"),
        (b"1 2 3 0 0 0 0 0\n", "t.tum:1: the quaternion"),
        (gzip.compress(b"1 2 3 4\n" * 99)[:-12], "damaged or cut off"),
    ],
)
def test_bad_files_are_named(tmp_path, content, says):
    path = tmp_path / "t.tum"
    path.write_bytes(content)
    with pytest.raises(InputError, match=says):
        read_tum(path)


@settings(suppress_health_check=NO_FIXTURE_CHECK, deadline=None)
@given(
    st.one_of(
        st.binary(max_size=80),
        st.lists(st.sampled_from(["1", "-1", "1e8", "1e308", "nan", "0", "x", "\n"]), max_size=40).map(
            lambda words: " ".join(words).encode()
        ),
    )
)
def test_any_bytes_are_a_trajectory_or_an_input_error(tmp_path, content):
    path = tmp_path / "t.tum"
    path.write_bytes(content)
    try:
        poses = read_tum(path)
    except InputError:
        return
    assert np.isfinite(poses.poses).all()


@given(
    st.lists(st.integers(0, 60), min_size=1, max_size=20),
    st.lists(st.integers(-5, 65), min_size=1, max_size=10),
    st.integers(0, 4),
)
def test_nearest_is_what_a_search_through_all_finds(stamps, asked, tolerance):
    trajectory = StampedPoses(np.array(stamps), np.zeros((len(stamps), 3)))
    found = trajectory.nearest(np.array(asked), tolerance * 1e-9)
    for stamp, index in zip(asked, found, strict=True):
        best = min(range(len(stamps)), key=lambda i: (abs(stamps[i] - stamp), stamps[i], i))
        assert index == (best if abs(stamps[best] - stamp) <= tolerance else -1)


def test_the_tolerance_is_exact_at_large_stamps():
    trajectory = StampedPoses(np.array([976052857337284000]), np.zeros((1, 3)))
    edge = 976052857337284000 + 100_000
    assert trajectory.nearest(np.array([edge, edge + 1]), 1e-4).tolist() == [0, -1]
    assert math.isclose(edge, edge + 1)  # as floats they could not be told apart
