"""The simulator as a driver: order and stamps of what it gives, closed loop, determinism, kidnapping."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest
from pydantic import ValidationError

from knotwork.core.errors import InputError
from knotwork.core.geometry import compose, relative
from knotwork.core.messages import Twist
from knotwork.plugins.drivers.sim2d import MANIFEST, Config
from knotwork.plugins.drivers.sim2d.driver import Sim2d


class FakeContext:
    """What the simulator asks of the runtime."""

    name = "sim"
    options = None

    def __init__(self, seed, **config):
        self.config = Config(**config)
        self.seed = seed
        self.counts = {}
        self.reports = []

    def count(self, name, by=1):
        self.counts[name] = self.counts.get(name, 0) + by

    def report(self, level, text):
        self.reports.append((level, text))


def simulate(drive=None, seed=1, **config):
    """Run to the end; `drive(t)` gives the command (v, w) after the measurements of each step."""
    context = FakeContext(seed, **config)
    sim = Sim2d(context)
    sim.warm()
    events, now = [], None
    for item in sim.events():
        if isinstance(item, int):
            command = drive(now * 1e-9) if drive is not None and now is not None else None
            if command is not None:
                sim.on_twist(Twist(stamp=now, vx=command[0], wz=command[1]))
            now = item
        events.append((now, item))
    return sim, context, events


def messages(events, port):
    return [item[1] for _, item in events if not isinstance(item, int) and item[0] == port]


def digest(events):
    sha = hashlib.sha256()
    for _, item in events:
        if isinstance(item, int):
            continue
        sha.update(f"{item[0]} {item[1].stamp}".encode())
        for name in ("pose", "twist", "covariance", "ranges", "angle", "velocity", "angular_velocity"):
            value = getattr(item[1], name, None)
            if value is not None:
                sha.update(np.asarray(value).tobytes())
    return sha.hexdigest()


def test_a_step_gives_the_applied_twist_then_the_measurements():
    _, _, events = simulate(lambda t: (0.1, 0.5), world="room", duration=1.0)
    times = [item for _, item in events if isinstance(item, int)]
    assert times == [k * 20_000_000 for k in range(51)]
    by_step = {t: [item[0] for at, item in events if at == t and not isinstance(item, int)] for t in times}
    assert by_step[0] == ["wheels", "odometry"]
    for t in times[1:]:
        expected = ["applied", "imu", "wheels", "odometry"]
        assert by_step[t] == expected + (["truth", "scan"] if t % 200_000_000 == 0 else [])
    for at, item in events:
        if not isinstance(item, int):
            late = 200_000_000 if item[0] in ("truth", "scan") else 0
            assert item[1].stamp == at - late
    assert set(MANIFEST.outputs) >= {p for ports in by_step.values() for p in ports}


def test_truth_belongs_to_its_scan_and_starts_at_zero():
    sim, _, events = simulate(lambda t: (0.15, 0.3), world="apartment", duration=3.0)
    truth, scans = messages(events, "truth"), messages(events, "scan")
    assert [m.scan_id for m in truth] == [m.scan_id for m in scans] == list(range(15))
    assert [m.stamp for m in truth] == [m.stamp for m in scans]
    assert {m.role for m in truth} == {"truth"}
    assert {m.frame for m in truth} == {"map"}
    np.testing.assert_array_equal(truth[0].pose, 0.0)
    world = messages(simulate(lambda t: (0.15, 0.3), world="apartment", duration=3.0, truth_frame="world")[2], "truth")
    np.testing.assert_allclose(world[0].pose, sim.world.start)
    for mapped, placed in zip(truth, world, strict=True):
        np.testing.assert_allclose(compose(sim.world.start, mapped.pose), placed.pose, atol=1e-12)


def test_the_truth_of_a_scan_is_the_pose_at_its_stamp():
    """Odometry without errors at the scan's stamp, one turn before the scan arrives."""
    _, _, events = simulate(
        lambda t: (0.15, np.sin(t)), world="room", duration=4.0, noise=False, start=(-1.0, -0.5, 0.3)
    )
    odometry = {m.stamp: m.pose for m in messages(events, "odometry")}
    truth = messages(events, "truth")
    assert len(truth) == 20
    for message in truth:
        np.testing.assert_allclose(message.pose, odometry[message.stamp], atol=1e-12)


def test_a_command_holds_over_the_next_step():
    """The command given after the measurements at k moves the robot over (k, k + 1]."""
    fast = {"acceleration": 100.0, "deceleration": 100.0}
    _, _, events = simulate(lambda t: (0.1 + 0.01 * t, 0.0), world="room", duration=1.0, noise=False, base=fast)
    for message in messages(events, "applied"):
        assert message.vx == pytest.approx(0.1 + 0.01 * (message.stamp * 1e-9 - 0.02))
    distances = np.diff([m.pose[0] for m in messages(events, "odometry")])
    np.testing.assert_allclose(distances, [m.vx * 0.02 for m in messages(events, "applied")], atol=1e-12)


def test_without_commands_it_brakes_after_the_timeout():
    def once(t):
        return (0.2, 0.0) if t < 0.5 else None  # the last one is stamped 0.48 s

    _, context, events = simulate(once, world="room", duration=1.5, noise=False, start=(-1.5, 0, 0))
    speed = {round(m.stamp * 1e-9, 2): m.vx for m in messages(events, "applied")}
    assert speed[0.74] == pytest.approx(0.2)  # the step from 0.72 s, 0.24 s after the command
    assert speed[0.76] < 0.2
    brake = np.diff([v for t, v in speed.items() if 0.74 <= t < 0.87])
    np.testing.assert_allclose(brake, -1.5 * 0.02)
    assert speed[0.90] == 0.0
    assert context.counts == {"command_timeouts": 1}


def test_a_command_that_is_no_number_is_ignored_and_told():
    _, context, events = simulate(lambda t: (float("nan"), 0.0), world="room", duration=0.2)
    assert context.counts["bad_commands"] > 0
    assert context.reports[0][0] == "warning"
    assert all(m.vx == 0.0 for m in messages(events, "applied"))


def test_same_seed_same_messages_other_seed_others():
    def run(seed):
        return digest(simulate(lambda t: (0.1, 0.2), seed=seed, world="apartment", duration=4.0)[2])

    assert run(7) == run(7)
    assert run(7) != run(8)


def test_kidnapped_robots_do_not_notice():
    """Truth jumps to the place; odometry, wheels and gyro go on as without it."""
    plain = simulate(lambda t: (0.1, 0.2), world="apartment", duration=3.0)[2]
    to = (5.4, 6.0, 1.0)
    sim, context, taken = simulate(
        lambda t: (0.1, 0.2), world="apartment", duration=3.0, kidnap=[{"at": 1.5, "to": to}]
    )
    for port in ("odometry", "wheels", "imu"):
        got, expected = messages(taken, port), messages(plain, port)
        assert digest([(0, (port, m)) for m in got]) == digest([(0, (port, m)) for m in expected])
    truth, before = messages(taken, "truth"), messages(plain, "truth")
    for message, without in zip(truth, before, strict=True):
        if message.stamp <= 1_400_000_000:
            np.testing.assert_array_equal(message.pose, without.pose)
        else:
            moved = relative(to, compose(sim.world.start, message.pose))
            assert np.hypot(*moved[:2]) < 0.1 * 1.5
    assert not np.array_equal(messages(taken, "scan")[-1].ranges, messages(plain, "scan")[-1].ranges)
    assert context.reports == [("info", "the robot is put at [5.4, 6.0, 1.0] of the world")]


def test_touching_an_obstacle_is_told_once():
    _, context, events = simulate(lambda t: (0.2, 0.0), world="room", duration=15.0)
    assert context.counts == {"collisions": 1}
    assert "touches an obstacle" in context.reports[0][1]
    assert messages(events, "truth")[-1].pose[0] == pytest.approx(2 - 0.105, abs=0.01)


def test_the_robot_must_not_start_in_a_wall():
    with pytest.raises(InputError, match="cannot stand at its start pose"):
        Sim2d(FakeContext(0, world="room", start=(1.95, 0.0, 0.0)))
    with pytest.raises(InputError, match="kidnap"):
        Sim2d(FakeContext(0, world="room", kidnap=[{"at": 1.0, "to": (1.95, 0.0, 0.0)}]))
    with pytest.raises(InputError, match="no world 'rom'"):
        Sim2d(FakeContext(0, world="rom"))


@pytest.mark.parametrize("bad", [{"duration": 0}, {"rate": -1}, {"lidar": {"beems": 3}}, {"kidnap": [{"at": 1}]}])
def test_config_mistakes(bad):
    with pytest.raises(ValidationError):
        Config(**bad)


def test_it_ends_when_the_robot_has_stood_long_enough():
    def wait_drive_stop(t):
        return (0.1 if 1.0 <= t < 2.0 else 0.0, 0.0)

    _, _, events = simulate(wait_drive_stop, world="room", duration=9.0, stop_when_idle=1.5)
    assert events[-1][0] * 1e-9 == pytest.approx(2.0 + 0.1 / 1.5 + 1.5, abs=0.05)


def test_progress_and_statistics():
    sim, _, _ = simulate(lambda t: (0.2, 0.0), world="room", duration=2.0, lidar={"accuracy": 0.0})
    assert sim.progress() == 1.0
    statistics = sim.statistics()
    assert statistics["range_scale"] == 1.0
    assert statistics["path_length_m"] == pytest.approx(0.38, abs=0.02)


def test_manifests_import_nothing_heavy():
    code = (
        "import sys, knotwork.plugins.drivers.sim2d, knotwork.plugins.policies.follow_path as f;"
        "assert f.MANIFEST.name == 'follow-path';"
        "sys.exit(any(m in sys.modules for m in ('numpy', 'numba', 'scipy')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
