"""The pseudo-terminal of a device: noise, plugging, latency."""

import os
from pathlib import Path

import numpy as np
import pytest
import serial

from knotwork.core.emulator.line import Line, Noise


@pytest.fixture
def line(tmp_path: Path):
    line = Line(tmp_path / "usb-device", np.random.default_rng(0))
    yield line
    line.close()
    assert not (tmp_path / "usb-device").exists()


def open_(line: Line) -> serial.Serial:
    return serial.Serial(str(line.link), 230_400, timeout=1.0)


def test_noise_is_what_it_says() -> None:
    noise = Noise(np.random.default_rng(1), drop=0.01, flip=0.001)
    data = bytes(200_000)
    left = noise.apply(data)
    assert noise.dropped == len(data) - len(left) == pytest.approx(2000, rel=0.15)
    assert noise.flipped == sum(b.bit_count() for b in left) == pytest.approx(1584, rel=0.15)
    assert Noise(np.random.default_rng(1)).apply(b"abc") == b"abc"


def test_bytes_go_both_ways_unchanged(line: Line) -> None:
    every = bytes(range(256))
    with open_(line) as client:
        line.send(every, 0)
        assert client.read(256) == every
        client.write(every)
        assert line.read() == every
    assert (line.sent, line.received, line.overrun) == (256, 256, 0)


def test_what_nobody_listens_to_is_lost(line: Line) -> None:
    line.send(b"early", 0)
    assert not line.connected()
    assert line.read() == b""
    with open_(line) as client:
        assert line.connected()
        line.send(b"late", 0)
        assert client.read(4) == b"late"
    line.send(b"gone", 0)
    with open_(line) as client:
        client.timeout = 0.05
        assert client.read(4) == b""
    assert line.sent == 4


def test_last_words_of_a_client_that_has_gone_are_heard(line: Line) -> None:
    assert line.deserted()
    with open_(line) as client:
        client.write(b"stop")
    assert not line.connected()
    assert not line.deserted()  # a device's loop would not look again otherwise
    assert line.read() == b"stop"
    assert line.deserted()


def test_replugged_under_another_name_behind_the_same_link(line: Line) -> None:
    first = os.readlink(line.link)
    client = open_(line)
    line.unplug()
    assert not line.link.exists()
    with pytest.raises(serial.SerialException):
        client.read(1)
    client.close()
    line.send(b"x", 0)
    assert line.read() == b""
    line.plug()
    assert os.readlink(line.link) != first
    with open_(line) as client:
        line.send(b"again", 0)
        assert client.read(5) == b"again"


def test_stalled_line_loses_everything(line: Line) -> None:
    with open_(line) as client:
        client.timeout = 0.05
        line.stalled = True
        line.send(b"abc", 0)
        client.write(b"abc")
        assert client.read(3) == b""
        assert line.read() == b""


def test_full_buffer_drops_instead_of_blocking(line: Line) -> None:
    with open_(line):
        for _ in range(100):
            line.send(bytes(1000), 0)
    assert line.overrun > 0
    assert line.sent + line.overrun == 100_000


def test_latency_keeps_the_order(line: Line) -> None:
    line.latency = 0.01
    data = bytes(range(200))
    with open_(line) as client:
        line.send(data, 1_000_000_000)
        due = line.next_due()
        assert due is not None
        assert 1_000_000_000 <= due <= 1_010_000_000
        line.flush(1_000_000_000 - 1)
        assert line.sent == 0
        line.flush(1_050_000_000)
        assert client.read(200) == data
