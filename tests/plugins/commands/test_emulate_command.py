"""`knotwork emulate`: what it prints, its fault switches, and how it ends."""

import argparse
import os
import signal
import subprocess
import sys
from pathlib import Path

import can
import pytest
import serial

from knotwork.core.errors import InputError
from knotwork.core.evaluation.tum import read_tum
from knotwork.core.protocols import agilex, lds02
from knotwork.plugins.commands.emulate.command import Emulate
from knotwork.plugins.commands.emulate.faults import Fault, rates, timed

PROGRAM = "import sys; from knotwork.core.cli.main import main; sys.exit(main())"


def emulate(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "emulate", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_rates() -> None:
    assert rates("--drop-bytes", []) == {"lidar": 0.0, "base": 0.0}
    assert rates("--drop-bytes", ["0.5", "base=0.001"]) == {"lidar": 0.5, "base": 0.001}
    for bad in ("1.1", "-1", "nan", "x", "wheel=0.1", "lidar="):
        with pytest.raises(InputError, match="expected"):
            rates("--drop-bytes", [bad])


def test_times() -> None:
    assert timed("--stall", "stall", ["lidar=3:0.5"]) == [Fault("lidar", "stall", 3.0, 0.5)]
    assert timed("--stall", "stall", ["2"]) == [Fault("lidar", "stall", 2.0, None), Fault("base", "stall", 2.0, None)]
    for bad in ("lidar=", "lidar=1:", "1:x", "motor=1"):
        with pytest.raises(InputError, match="expected"):
            timed("--stall", "stall", [bad])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_prints_its_devices_and_ends_cleanly(tmp_path: Path, number: signal.Signals) -> None:
    truth, ports = tmp_path / "truth.tum", tmp_path / "ports"
    process = emulate(
        "turtlebot3", "--world", "arena", "--lidar", "lds02", "--base", "dynamixel",
        "--truth", str(truth), "--ports", str(ports),
    )  # fmt: skip
    assert process.stdout is not None
    lines = dict(process.stdout.readline().split() for _ in range(2))
    assert list(lines) == ["lidar:", "base:"]
    assert os.readlink(lines["base:"]).startswith("/dev/")
    with serial.Serial(lines["lidar:"], lds02.BAUD, timeout=5.0) as client:
        assert len(lds02.Parser().feed(client.read(2350))) >= 48
    process.send_signal(number)
    output, errors = process.communicate(timeout=20)
    assert (process.returncode, output, errors) == (0, "", "")
    assert list(ports.iterdir()) == []
    assert len(read_tum(truth).stamps) > 5


def test_scheduled_faults_and_duration(tmp_path: Path) -> None:
    events = tmp_path / "events.jsonl"
    process = emulate(
        "turtlebot3", "--world", "arena", "--duration", "1.2", "--events", str(events),
        "--stall", "base=0.2:0.2", "--unplug-at", "lidar=0.3:0.3", "--drop-bytes", "0.01",
    )  # fmt: skip
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (0, "")
    kinds = [line.split('"event": "')[1].split('"')[0] for line in events.read_text().splitlines()]
    assert kinds == ["stall", "unplug", "stall", "plug"]


@pytest.mark.parametrize(
    "options",
    [["--seed", "-1"], ["--duration", "nan"], ["--range-error", "0.7"], ["--latency", "-1"], ["--spin-up", "99"]],
)
def test_numbers_out_of_bounds(options: list[str]) -> None:
    parser = argparse.ArgumentParser()
    command = Emulate()
    command.arguments(parser)
    with pytest.raises(InputError, match=f"{options[0]}: expected"):
        command.run(parser.parse_args(["turtlebot3", *options]))


def test_mistakes_are_one_line() -> None:
    process = emulate("turtlebot3", "--world", "nowhere")
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert errors.startswith("knotwork: no world 'nowhere'")
    assert errors.count("\n") == 1


def test_agilex_on_multicast(tmp_path: Path) -> None:
    events, channel = tmp_path / "events.jsonl", "239.74.163.77"
    try:
        bus = can.Bus(interface="udp_multicast", channel=channel, port=43999)
    except (can.CanError, OSError) as error:
        pytest.skip(f"no multicast here: {error}")
    with bus:
        process = emulate(
            "agilex", "--world", "arena", "--channel", channel, "--port", "43999", "--events", str(events)
        )
        assert process.stdout is not None
        assert process.stdout.readline() == f"can: udp_multicast {channel}\n"
        decoder = agilex.Decoder()
        names = set()
        for frame in (agilex.encode("ControlMode", mode=agilex.CAN), agilex.motion_command(0.2, 0.0)):
            bus.send(can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False))
        for _ in range(200):
            message = bus.recv(1.0)
            if message is None:
                break
            decoded = decoder.decode(message.arbitration_id, message.data)
            assert decoded is not None
            names.add(decoded.name)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    assert (process.returncode, errors) == (0, "")
    assert {"SystemState", "MotionState", "Odometer"} <= names
    kinds = [line.split('"event": "')[1].split('"')[0] for line in events.read_text().splitlines()]
    assert kinds == ["mode", "command", "moving", "watchdog", "standing"]
