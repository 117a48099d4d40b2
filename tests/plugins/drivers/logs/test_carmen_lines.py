import gzip
import lzma
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from knotwork.core.errors import DriverError, KnotworkError
from knotwork.core.stamps import format_seconds
from knotwork.plugins.drivers.carmen import MANIFEST, CarmenConfig
from knotwork.plugins.drivers.carmen.driver import CarmenDriver, _numbers


def flaser(n=180, stamp="976052857.337284", ranges=None, sensor=(1.0, 2.0, 0.5), robot=None, keyword="FLASER"):
    ranges = ranges if ranges is not None else ["1.25"] * n
    poses = " ".join(f"{value:.6f}" for value in (*sensor, *(robot or sensor)))
    return f"{keyword} {len(ranges)} {' '.join(ranges)} {poses} {stamp} host 0.25"


def robotlaser(ranges, start=-1.0, step=0.01, farthest=30.0, remissions=(), stamp="5.000001"):
    return (
        f"ROBOTLASER1 0 {start} 2.0 {step} {farthest} 0.01 0 {len(ranges)} {' '.join(ranges)}"
        f" {len(remissions)} {' '.join(remissions)} 1.1 2.0 0.0 1.0 2.0 0.0 0.3 0.1 0 0 0 {stamp} host 1.0"
    )


ODOM = "ODOM 1.0 2.0 0.5 0.3 -0.1 0.0 12.5 host 0.1"


@pytest.fixture
def read(run_driver, tmp_path):
    def run(text, error=None, **config):
        path = tmp_path / "log.clf"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return run_driver(CarmenDriver, CarmenConfig(path=str(path), **config), error)

    return run


def scans(events):
    return [message for port, message in events if port == "scan"]


def test_manifest_says_what_the_driver_gives():
    assert MANIFEST.kind == "driver"
    assert {name: port.message for name, port in MANIFEST.outputs.items()} == {
        "scan": "scan",
        "odometry": "odometry",
    }


def test_a_scan_follows_its_odometry_with_the_same_stamp_and_the_digits_of_the_log(read):
    events, _ = read("# comment\n\n" + flaser() + "\n")
    (first, odometry), (second, scan) = events
    assert (first, second) == ("odometry", "scan")
    assert odometry.stamp == scan.stamp == 976052857337284000
    assert format_seconds(scan.stamp) == "976052857.337284"
    assert np.array_equal(odometry.pose, (1.0, 2.0, 0.5))
    assert np.array_equal(scan.ranges, np.full(180, 1.25, np.float32))
    assert scan.scan_id == 0
    assert scan.mount == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("n", "step"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)])
def test_angles_by_beam_count(read, n, step):
    events, _ = read(flaser(n))
    scan = scans(events)[0]
    assert scan.angle_min == -math.pi / 2
    assert scan.angle_increment == math.radians(step)


def test_angles_of_other_beam_counts_come_from_the_config(read):
    events, context = read(flaser(541), error=DriverError)
    assert events == []
    assert "angle_min and angle_increment" in context.error
    events, _ = read(flaser(541), angle_min=-2.356, angle_increment=0.00436)
    assert (scans(events)[0].angle_min, scans(events)[0].angle_increment) == (-2.356, 0.00436)


def test_what_the_config_says_of_angles_holds_for_every_line(read):
    events, _ = read(flaser(180), angle_min=math.radians(-89.0))
    assert scans(events)[0].angle_min == math.radians(-89.0)
    assert scans(events)[0].angle_increment == math.radians(1.0)


def test_robotlaser_carries_its_angles_range_remissions_and_mount(read):
    events, _ = read(robotlaser(["1.0", "29.9", "30.0", "81.9"], remissions=["1", "2", "3", "4"]))
    scan = scans(events)[0]
    assert (scan.angle_min, scan.angle_increment, scan.range_max) == (-1.0, 0.01, 30.0)
    assert np.array_equal(scan.ranges, np.float32([1.0, 29.9, np.inf, np.inf]))
    assert np.array_equal(scan.intensities, np.float32([1, 2, 3, 4]))
    assert scan.mount == (0.1, 0.0, 0.0)
    assert scan.stamp == 5_000_001_000
    assert np.array_equal(events[0][1].pose, (1.0, 2.0, 0.0))


def test_robotlaser_without_angles_falls_back_to_the_beam_count(read):
    events, _ = read(robotlaser(["1.0"] * 181, step=0.0, farthest=0.0))
    scan = scans(events)[0]
    assert (scan.angle_min, scan.angle_increment) == (-math.pi / 2, math.radians(1.0))
    assert scan.range_max == 40.0
    assert scan.intensities is None


def test_ranges_at_and_beyond_the_limits(read):
    texts = ["39.99", "40.00", "81.83", "inf", "0.00", "-1.0", "nan", "0.05", "0.10", *["1"] * 171]
    (_, (_, scan)), _ = read(flaser(ranges=texts), range_min=0.1)
    nan, inf = np.nan, np.inf
    expected = np.float32([39.99, inf, inf, inf, nan, nan, nan, nan, 0.1])
    assert np.array_equal(scan.ranges[:9], expected, equal_nan=True)
    assert (scan.range_min, scan.range_max) == (0.1, 40.0)
    (_, (_, scan)), _ = read(flaser(ranges=texts), no_return=81.9)
    assert np.array_equal(scan.ranges[:4], np.float32([39.99, 40.0, 81.83, inf]))


def test_mount_is_the_sensor_seen_from_the_robot_in_spite_of_rounding(read):
    robot = (3.1, -2.7, 2.2)
    lines = []
    for turn in range(20):
        x, y, yaw = robot[0] + turn, robot[1], robot[2] + 0.7 * turn
        sensor = (x - 0.04 * math.cos(yaw), y - 0.04 * math.sin(yaw), yaw)
        lines.append(flaser(sensor=sensor, robot=(x, y, math.remainder(yaw, math.tau))))
    events, context = read("\n".join(lines))
    assert {scan.mount for scan in scans(events)} == {(-0.04, 0.0, 0.0)}
    assert context.reports == []
    events, _ = read("\n".join(lines), mount=(0.1, 0.2, 0.3))
    assert {scan.mount for scan in scans(events)} == {(0.1, 0.2, 0.3)}


def test_sensor_poses_that_wander_over_the_robot_are_reported_once(read):
    lines = [flaser(sensor=(0.5 * i, 0, 0), robot=(0.4 * i, 0, 0)) for i in range(10)]
    events, context = read("\n".join(lines))
    assert {scan.mount for scan in scans(events)} == {(0.0, 0.0, 0.0)}
    assert [text for _, text in context.reports if "one place" in text] == [context.reports[0][1]]


def test_odom_lines_are_robot_poses_with_velocities(read):
    events, _ = read(ODOM + "\n" + flaser())
    port, odometry = events[0]
    assert port == "odometry"
    assert odometry.stamp == 12_500_000_000
    assert np.array_equal(odometry.pose, (1.0, 2.0, 0.5))
    assert np.array_equal(odometry.twist, (0.3, 0.0, -0.1))
    assert [port for port, _ in events] == ["odometry", "odometry", "scan"]


def test_odometry_can_be_withheld(read):
    events, _ = read(ODOM + "\n" + flaser(), odometry=False)
    assert [port for port, _ in events] == ["scan"]


def test_the_same_scan_in_two_formats_is_given_once_and_the_rear_laser_on_request(read):
    text = "\n".join([flaser(), robotlaser(["1"] * 180), flaser(keyword="RLASER"), flaser()])
    events, context = read(text)
    assert [scan.angle_min for scan in scans(events)] == [-math.pi / 2] * 2
    assert context.counts == {"other_lines": 2}
    assert len(scans(read(text, laser="RLASER")[0])) == 1
    assert scans(read(text, laser="ROBOTLASER1")[0])[0].angle_min == -1.0


def test_a_log_of_another_laser_says_which_key_to_set(read):
    _, context = read(flaser(keyword="RLASER"), error=DriverError)
    assert "set laser: RLASER" in context.error
    _, context = read(ODOM + "\n" + flaser(keyword="RLASER"))
    assert "set laser: RLASER" in context.reports[-1][1]


def test_log_order_is_kept_where_stamps_run_backwards(read):
    stamps = ["5.0", "4.0", "6.0", "3.0"]
    events, _ = read("\n".join(flaser(stamp=stamp) for stamp in stamps))
    assert [scan.stamp for scan in scans(events)] == [int(float(s) * 1e9) for s in stamps]
    assert [scan.scan_id for scan in scans(events)] == [0, 1, 2, 3]


def test_limit_start_and_stop_cut_the_log(read):
    text = "\n".join(flaser(stamp=f"{100 + i}.0") for i in range(10))
    assert len(scans(read(text, limit=3)[0])) == 3
    events, _ = read(text, start=2.0, stop=5.0)
    assert [scan.stamp // 10**9 for scan in scans(events)] == [102, 103, 104, 105]
    assert [scan.scan_id for scan in scans(events)] == [0, 1, 2, 3]
    assert len(events) == 8
    events, context = read(text, start=50.0)
    assert events == []
    assert "no scan in the part" in context.reports[-1][1]
    with pytest.raises(ValidationError, match="stop must be after start"):
        CarmenConfig(path="x", start=2.0, stop=1.0)


BAD = [
    flaser()[:400],
    flaser().replace("FLASER 180", "FLASER 179"),
    flaser(ranges=["1"] * 179 + ["x"]),
    flaser(stamp="noon"),
    flaser().replace("1.000000", "nan", 1),
    "FLASER",
    "FLASER -3 1 2",
    "FLAS",
    ODOM + " 1",
    "\x00\x01\x02",
    "12 34",
]


@pytest.mark.parametrize("bad", BAD)
def test_a_bad_line_is_counted_named_and_skipped(read, bad):
    events, context = read("# first\n" + flaser() + "\n" + bad + "\n" + flaser())
    assert len(scans(events)) == 2
    assert context.counts["malformed_lines"] == 1
    assert len(context.reports) == 1
    assert "log.clf:3: " in context.reports[0][1]


@pytest.mark.parametrize("bad", BAD)
def test_strict_ends_at_a_bad_line_after_giving_what_came_before(read, bad):
    events, context = read(flaser() + "\n" + bad + "\n" + flaser(), error=DriverError, strict=True)
    assert len(scans(events)) == 1
    assert "log.clf:2: " in context.error
    assert "\n" not in context.error


@pytest.mark.parametrize("length", [12, 30, 50, 70, 100])
def test_a_cut_robotlaser_line_is_bad(read, length):
    line = robotlaser(["1"] * 10, remissions=["2"] * 10)
    events, context = read("\n".join((line, line[:length], line)))
    assert len(scans(events)) == 2
    assert context.counts == {"malformed_lines": 1}


def test_the_first_bad_lines_are_named_the_rest_summed(read):
    _, context = read(flaser() + "\n" + "???\n" * 30)
    assert context.counts["malformed_lines"] == 30
    assert [text.split(":")[1] for _, text in context.reports[:5]] == ["2", "3", "4", "5", "6"]
    assert len(context.reports) == 6
    assert "30 malformed lines" in context.reports[5][1]


@pytest.mark.parametrize("text", ["PARAM robot_length 0.5 host 0.1", "SYNC tag 1 host 1", "NMEAGGA 1 2 3"])
def test_other_carmen_messages_are_no_fault(read, text):
    _, context = read(text + "\n" + flaser())
    assert context.counts == {"other_lines": 1}
    assert context.reports == []


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is empty"),
        (b"\n \n", "is empty"),
        (b"# only\n# comments\n", "nothing usable"),
        (b"PARAM a b c\n", "nothing usable"),
        (b"stamp,x,y\n1,2,3\n", "nothing usable"),
        (b"\x89PNG\r\n\x1a\n" + bytes(5000), "nothing usable"),
        (b"\x00" * (3 << 20), "nothing usable"),
        (b"1 2\n" * 20000, "nothing usable"),
        (gzip.compress(b"x" * 999)[:20], "nothing usable"),
    ],
)
def test_a_file_of_another_kind_is_one_clear_line(read, content, says):
    events, context = read(content, error=DriverError)
    assert events == []
    assert says in context.error
    assert "log.clf" in context.error
    assert "expected a CARMEN log" in context.error
    assert "\n" not in context.error
    assert len(context.reports) <= 7


def test_a_missing_file_is_a_driver_error(run_driver, tmp_path):
    _, context = run_driver(CarmenDriver, CarmenConfig(path=str(tmp_path / "no.clf")), DriverError)
    assert "no.clf: no such file" in context.error


@pytest.mark.parametrize("pack", [gzip.compress, lzma.compress])
def test_a_cut_packed_log_gives_what_was_read(read, pack):
    rng = np.random.default_rng(1)
    text = "\n".join(flaser(stamp=f"{i}.5", ranges=[f"{r:.2f}" for r in rng.uniform(1, 30, 180)]) for i in range(400))
    packed = pack(text.encode())
    whole = scans(read(packed)[0])
    events, context = read(packed[: len(packed) // 2])
    assert 50 < len(scans(events)) < 400
    for a, b in zip(scans(events), whole, strict=False):
        assert a.stamp == b.stamp
        assert np.array_equal(a.ranges, b.ranges)
    assert context.counts == {"damaged_files": 1}
    assert "cut off" in context.reports[-1][1]
    strict, context = read(packed[: len(packed) // 2], error=DriverError, strict=True)
    assert len(strict) == len(events)


LINES = [
    flaser(3).encode(),
    flaser().encode(),
    ODOM.encode(),
    robotlaser(["1"] * 4).encode(),
    b"# c",
    b"PARAM a",
]
WORDS = [
    b"FLASER",
    b"ODOM",
    b"ROBOTLASER1",
    b"3",
    b"1e400",
    b"nan",
    b"-1",
    b"1e308",
    b"-1e308",
    b"0.5",
    b"host",
]


@st.composite
def spoiled(draw):
    line = draw(st.sampled_from(LINES))
    what = draw(st.sampled_from(["cut", "swap", "noise", "words"]))
    if what == "cut":
        return line[: draw(st.integers(0, len(line)))]
    if what == "swap":
        fields = line.split()
        for _ in range(draw(st.integers(1, 3))):
            fields[draw(st.integers(0, len(fields) - 1))] = draw(st.sampled_from(WORDS))
        return b" ".join(fields)
    if what == "noise":
        at = draw(st.integers(0, len(line)))
        return line[:at] + draw(st.binary(max_size=20)) + line[at:]
    return b" ".join(draw(st.lists(st.sampled_from(WORDS), max_size=30)))


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    st.lists(st.one_of(spoiled(), st.binary(max_size=60)), max_size=12),
    st.sampled_from([bytes, gzip.compress, lzma.compress]),
    st.integers(0, 60),
    st.booleans(),
)
def test_no_bytes_raise_anything_but_a_clear_error(run_driver, tmp_path, lines, pack, cut, strict):
    packed = pack(b"\n".join(lines))
    path = tmp_path / "log"
    path.write_bytes(packed[: max(len(packed) - cut, 0)])
    config = CarmenConfig(path=str(path), strict=strict, angle_min=0.0, angle_increment=0.1)
    try:
        events, _ = run_driver(CarmenDriver, config)
    except KnotworkError:
        return
    for i, scan in enumerate(scans(events)):
        assert scan.scan_id == i
        assert not (scan.ranges <= 0).any()
        assert np.isfinite(scan.mount).all()


plain = st.floats(-1e6, 1e6).map(lambda x: f"{x:.2f}") | st.floats(allow_nan=False).map(repr)
odd = st.sampled_from(["+1", ".5", "5.", "007", "1e3", "-0", "nan", "inf", "-Infinity", "1_0", "1e400", "1" * 30])


@given(st.lists(plain | odd, min_size=1, max_size=30), st.sampled_from([" ", "  ", "\t"]))
def test_numbers_read_together_are_those_read_one_by_one(texts, space):
    read = _numbers(space.join(texts).encode())
    np.testing.assert_array_equal(read, [float(text) for text in texts])  # to the last bit but the sign of zero


@pytest.mark.parametrize("junk", ["x", "1,2", "[1]", "null", "true", '"1"', "1 2]", "0x10", "--1", "1e"])
def test_junk_among_numbers_is_named(junk):
    with pytest.raises(ValueError, match="is not a number"):
        _numbers(f"1.25 {junk} 2".encode())
