"""The whole emulated robot in real time, with ROBOTIS's own SDK as its host."""

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import dynamixel_sdk as sdk
import pytest
import serial

from knotwork.core.clock import epoch
from knotwork.core.emulator.turtlebot3 import Settings, TurtleBot3
from knotwork.core.errors import InputError
from knotwork.core.evaluation.tum import read_tum
from knotwork.core.protocols import lds01, opencr, xl430
from knotwork.core.world.scene import World, box

PACKETS = sdk.PacketHandler(2.0)


@pytest.fixture(autouse=True)
def fair() -> Iterator[None]:
    """The SDK waits by spinning; threads must take turns often for the emulator to live beside it."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-4)
    yield
    sys.setswitchinterval(before)


class Host:
    """The SDK on the robot's base."""

    def __init__(self, robot: TurtleBot3) -> None:
        self.port = sdk.PortHandler(robot.base_path)
        self.port.openPort()
        self.port.setBaudRate(1_000_000)

    def ask(self, call: Callable[..., Any], *arguments: Any) -> Any:
        """Ask until it answers: the SDK's time-out is 34 ms, and the test machine may be busy."""
        for _ in range(50):
            reply = call(*arguments)
            result = reply[-2] if isinstance(reply, tuple) else reply
            if result == sdk.COMM_SUCCESS:
                return reply
        raise AssertionError(f"no answer: {reply}")

    def beat(self, seconds: float, v: int, device: int = opencr.DEVICE) -> None:
        """Drive with a beating heart."""
        end = time.monotonic() + seconds
        k = 0
        while time.monotonic() < end:
            k += 1
            self.ask(PACKETS.write1ByteTxRx, self.port, device, 19, k % 255 + 1)
            self.ask(PACKETS.write4ByteTxRx, self.port, device, 150, v)
            time.sleep(0.05)


def test_the_sdk_drives_an_opencr(tmp_path: Path) -> None:
    truth, events = tmp_path / "truth.tum", tmp_path / "events.jsonl"
    begin = epoch()
    with TurtleBot3(Settings(world="arena", truth=truth, events=events)) as robot:
        host = Host(robot)
        assert host.ask(PACKETS.ping, host.port, 200) == (opencr.MODEL_NUMBER, 0, 0)
        data, _, error = host.ask(PACKETS.readTxRx, host.port, 200, 10, 172)
        assert (len(data), error) == (172, 0)
        for _ in range(20):  # on a slow machine the heart may falter
            host.beat(1.0, 10)
            data, _, _ = host.ask(PACKETS.readTxRx, host.port, 200, 128, 8)
            if bytes(data) == (126).to_bytes(4, "little") * 2:
                break
        else:
            raise AssertionError(data)
        stop = epoch()
        host.port.closePort()
        rest = robot.rest_after(stop)
        assert rest is not None
        assert max(abs(w.left) for w in robot.wheels) == pytest.approx(126 * opencr.VELOCITY_UNIT * 0.033)
        x, y, _ = robot.pose()
        assert x > 0.05
        assert robot.path_length == pytest.approx(x, abs=0.01)
        kinds = [event.kind for event in robot.events]
        assert kinds[-2:] == ["heartbeat", "standing"]
    poses = read_tum(truth)
    assert begin <= poses.stamps[0]
    assert poses.stamps[-1] <= epoch()
    assert poses.poses[0].tolist() == [0.0, 0.0, 0.0]
    assert poses.poses[-1][:2] == pytest.approx((x, y), abs=1e-5)
    written = [json.loads(line)["event"] for line in events.read_text().splitlines()]
    assert written == kinds


def test_the_sdk_drives_bare_motors() -> None:
    with TurtleBot3(Settings(world="arena", base="dynamixel")) as robot:
        host = Host(robot)
        for motor in (1, 2):
            assert host.ask(PACKETS.ping, host.port, motor)[0] == xl430.XL430
            assert host.ask(PACKETS.write1ByteTxRx, host.port, motor, 64, 1)[1] == 0
            assert host.ask(PACKETS.write1ByteTxRx, host.port, motor, 98, 100)[1] == 0
            assert host.ask(PACKETS.write4ByteTxRx, host.port, motor, 104, 300)[1] == 6
        write = sdk.GroupSyncWrite(host.port, PACKETS, 104, 4)
        read = sdk.GroupSyncRead(host.port, PACKETS, 126, 10)
        for motor in (1, 2):
            write.addParam(motor, [100, 0, 0, 0])
            read.addParam(motor)
        assert write.txPacket() == sdk.COMM_SUCCESS
        for call in (read.txRxPacket, read.fastSyncRead):
            time.sleep(0.2)
            host.ask(call)
            assert [read.getData(motor, 128, 4) for motor in (1, 2)] == [100, 100]
        for motor in (1, 2):
            host.ask(PACKETS.write1ByteTxRx, host.port, motor, 98, 5)
        stop = epoch()
        host.port.closePort()
        assert robot.rest_after(stop) is not None
        assert [e.kind for e in robot.events].count("bus_watchdog") == 2


def test_unplug_and_replug_of_the_lidar() -> None:
    with TurtleBot3(Settings(world="arena", spin_up=0.1)) as robot:
        name = os.readlink(robot.lidar_path)
        client = serial.Serial(robot.lidar_path, lds01.BAUD, timeout=2.0)
        parser = lds01.Parser()
        assert parser.feed(client.read(420))
        robot.unplug("lidar")
        with pytest.raises(serial.SerialException):
            client.read(4200)
        client.close()
        assert not Path(robot.lidar_path).exists()
        robot.replug("lidar")
        assert os.readlink(robot.lidar_path) != name
        with serial.Serial(robot.lidar_path, lds01.BAUD, timeout=2.0) as client:
            assert len(lds01.Parser().feed(client.read(420))) >= 9
        assert [e.kind for e in robot.events] == ["unplug", "plug"]


def test_noise_and_stall_of_the_lidar() -> None:
    with TurtleBot3(Settings(world="arena", seed=3)) as robot:
        robot.disturb("lidar", drop=0.01, flip=0.001)
        parser = lds01.Parser()
        with serial.Serial(robot.lidar_path, lds01.BAUD, timeout=2.0) as client:
            parser.feed(client.read(12_600))
            # 0.99^42 * 0.999^336 = 0.47 of the packets survive
            assert 0.3 < parser.packets / 300 < 0.6
            assert parser.rejected > 0
            assert robot.line("lidar").noise.dropped > 60
            robot.stall("lidar")
            client.reset_input_buffer()
            client.timeout = 0.1
            client.read(10_000)
            assert client.read(10) == b""
            robot.stall("lidar", False)
            client.timeout = 2.0
            assert len(client.read(84)) == 84


def test_what_cannot_be_built(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no world"):
        TurtleBot3(Settings(world="nowhere"))
    with pytest.raises(InputError, match="obstacle"):
        TurtleBot3(Settings(world=World("room", box(0.0, 0.0, 2.0, 2.0), start=(0.2, 1.0, 0.0)), model="waffle"))
    with pytest.raises(InputError, match="cannot write"):
        TurtleBot3(Settings(world="arena", truth=tmp_path / "none" / "truth.tum"))
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(InputError, match="links"):
        TurtleBot3(Settings(world="arena", folder=file))
