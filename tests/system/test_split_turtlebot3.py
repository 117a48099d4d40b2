"""The two halves of a TurtleBot3 as two processes, and the cable between them pulled."""

import select
import signal
import socket
import time

import pytest
from tcp_proxy import Proxy

from knotwork.core.emulator.turtlebot3 import Settings, TurtleBot3
from knotwork.core.log.reader import Log
from knotwork.core.registry import Registry

pytest.importorskip("zenoh", reason="needs knotwork[zenoh]")

PATIENCE = 240  # s; kernels may have to be compiled first


def until(condition, processes, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        for process in processes:
            assert process.poll() is None, process.communicate()
        assert time.monotonic() < end, "it does not happen"
        time.sleep(0.02)


@pytest.fixture
def half(start, tmp_path):
    begun = []

    def begin(name, *sets):
        given = [part for text in sets for part in ("--set", text)]
        process = start("run", f"configs:turtlebot3-split/{name}.yaml", "--out", tmp_path / name, "--quiet", *given)
        begun.append(process)
        return process

    yield begin
    for process in begun:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.mark.slow
def test_a_lost_link_stops_the_robot_and_is_survived(half, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    with TurtleBot3(Settings(world="apartment")) as robot:
        with open(robot.lidar_path, "rb", buffering=0) as lidar:
            select.select([lidar], [], [], PATIENCE)  # its kernels are compiled now
        proxy = Proxy(port)
        on_robot = half(
            "robot",
            f"vars.lidar={robot.lidar_path}",
            f"vars.base={robot.base_path}",
            f"vars.listen=tcp/127.0.0.1:{port}",
            "nodes.base.safety.rearm=auto",
        )
        on_workstation = half(
            "workstation",
            f"vars.robot=tcp/127.0.0.1:{proxy.port}",
            "nodes.drive={plugin: follow-path, world: apartment}",
            "nodes.live.port=0",
        )
        both = [on_robot, on_workstation]
        until(lambda: robot.path_length > 0.3, both, PATIENCE)

        proxy.stalled = True
        until(lambda: robot.robot.speeds == (0.0, 0.0), both, 5)
        driven = robot.path_length
        time.sleep(2.0)
        assert robot.path_length - driven < 0.02  # nothing moves it while nobody can stop it
        proxy.stalled = False
        until(lambda: robot.path_length > driven + 0.2, both)

        on_workstation.send_signal(signal.SIGINT)
        said = on_workstation.communicate(timeout=60)
        assert on_workstation.returncode == 0, said
        until(lambda: robot.robot.speeds == (0.0, 0.0), [on_robot], 5)
        on_robot.send_signal(signal.SIGINT)
        said = on_robot.communicate(timeout=60)
        assert on_robot.returncode == 0, said
        proxy.close()
    there = [m.stamp for _, m in Log(tmp_path / "robot" / "log.mcap").messages(streams=["base.odometry"])]
    here = [m.stamp for _, m in Log(tmp_path / "workstation" / "log.mcap").messages(streams=["robot.odometry"])]
    assert len(here) > 200
    first = there.index(here[0])
    assert here == there[first : first + len(here)]  # origin's stamps, in order, none lost
    Registry(third_parties=False).records()  # knows the plugins' own message types
    states = [m for _, m in Log(tmp_path / "workstation" / "log.mcap").messages(streams=["robot.link"])]
    assert states[-1].lost == 0
    assert {m.up for m in states} == {True, False}
