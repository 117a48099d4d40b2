import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from knotwork.core.errors import DriverError, KnotworkError
from knotwork.plugins.drivers.gazebo_text import GazeboTextConfig
from knotwork.plugins.drivers.gazebo_text.driver import GazeboTextDriver
from knotwork.plugins.drivers.minesrover import MinesroverConfig
from knotwork.plugins.drivers.minesrover.driver import MinesroverDriver

GAZEBO = "1.0 2.0 0.5 0.0 0.3 0.1 inf 0.05 0.12 3.6"
DRIVERS = {"gazebo": (GazeboTextDriver, GazeboTextConfig), "rover": (MinesroverDriver, MinesroverConfig)}


def rover(time=1_000_001, left=0, right=0, ranges=None):
    return " ".join(map(str, (time, 0, left, right, *[0] * 20, *(ranges or [1500] * 682), 0)))


@pytest.fixture
def read(run_driver, tmp_path):
    def run(kind, text, error=None, **config):
        path = tmp_path / "log.txt"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        driver, model = DRIVERS[kind]
        return run_driver(driver, model(path=str(path), **config), error)

    return run


def test_gazebo_line(read):
    events, _ = read("gazebo", GAZEBO)
    (_, truth), (_, scan) = events
    assert np.array_equal(truth.pose, (1.0, 2.0, 0.5))
    assert np.array_equal(scan.ranges, np.float32([np.inf, np.nan, 0.12, np.inf]), equal_nan=True)
    assert (scan.angle_min, scan.angle_increment) == (0.0, 0.1)
    assert (scan.range_min, scan.range_max, scan.mount) == (0.12, 3.5, (-0.032, 0.0, 0.0))


def test_a_bad_gazebo_line_takes_its_time(read):
    events, context = read("gazebo", "\n".join((GAZEBO, GAZEBO[:20], GAZEBO)))
    assert [(message.stamp, message.scan_id) for port, message in events if port == "scan"] == [
        (0, 0),
        (400_000_000, 1),
    ]
    assert context.counts == {"malformed_lines": 1}


def test_rover_ranges(read):
    ranges = [1500] * 682
    ranges[100:104] = [0, 10, 4000, 4001]
    events, _ = read("rover", rover(ranges=ranges))
    scan = events[1][1]
    assert scan.stamp == 1_000_001_000
    assert np.array_equal(scan.ranges[100:104], np.float32([np.inf, np.nan, 4.0, np.inf]), equal_nan=True)
    assert np.isnan(scan.ranges[:70]).all()
    assert np.isnan(scan.ranges[-70:]).all()
    assert np.array_equal(scan.ranges[[70, 611]], np.float32([1.5, 1.5]))
    events, _ = read("rover", rover(ranges=ranges), zero="invalid", odometry=False)
    assert [port for port, _ in events] == ["scan"]
    assert np.isnan(events[0][1].ranges[100])


def test_rover_odometry_follows_a_circle(read):
    # Left wheel at rest: the robot turns about it by the right wheel's way over the axle.
    axle, radius, ticks = 0.330, 0.077, 2000.0
    per_step = round(axle * math.pi / 2 / (math.tau * radius) * ticks / 10)
    lines = [rover(time=i, left=7, right=-3 + i * per_step) for i in range(11)]
    events, _ = read("rover", "\n".join(lines))
    pose = events[-2][1].pose
    turn = 10 * per_step * math.tau * radius / ticks / axle
    assert pose == pytest.approx((axle / 2 * math.sin(turn), axle / 2 * (1 - math.cos(turn)), turn))


def test_an_encoder_reset_is_a_discontinuity(read):
    events, _ = read("rover", "\n".join((rover(left=90000, right=90000), rover(), rover(left=100, right=100))))
    odometry = [message for port, message in events if port == "odometry"]
    assert [message.discontinuity for message in odometry] == [False, True, False]
    assert odometry[2].pose == pytest.approx((100 * math.tau * 0.077 / 2000, 0.0, 0.0))


@pytest.mark.parametrize("kind", DRIVERS)
@pytest.mark.parametrize(
    ("content", "says"),
    [(b"", "is empty"), (b"FLASER 3 1 1 1\n", "nothing usable"), (bytes(999), "nothing usable")],
)
def test_a_file_of_another_kind_is_one_clear_line(read, kind, content, says):
    _, context = read(kind, content, error=DriverError)
    assert says in context.error
    assert "\n" not in context.error


WORDS = [
    "0",
    "1",
    "-1",
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "9" * 30,
    "9" * 400,
    "x",
    "0.1",
    "\xff",
    "#",
]


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.sampled_from(list(DRIVERS)), st.data())
def test_no_bytes_raise_anything_but_a_clear_error(run_driver, tmp_path, kind, data):
    fields = (GAZEBO if kind == "gazebo" else rover()).split()
    lines = []
    for _ in range(data.draw(st.integers(0, 4))):
        line = list(fields)
        for _ in range(data.draw(st.integers(0, 3))):
            line[data.draw(st.integers(0, min(len(line), 40) - 1))] = data.draw(st.sampled_from(WORDS))
        lines.append(" ".join(line).encode()[: data.draw(st.integers(0, 5000))])
    lines.append(data.draw(st.binary(max_size=50)))
    path = tmp_path / "log"
    path.write_bytes(b"\n".join(lines))
    driver, model = DRIVERS[kind]
    try:
        events, _ = run_driver(driver, model(path=str(path), strict=data.draw(st.booleans())))
    except KnotworkError:
        return
    for port, message in events:
        if port == "odometry":
            assert np.isfinite(message.pose).all()
