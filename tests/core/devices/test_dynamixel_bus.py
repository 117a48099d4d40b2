"""Transactions with a device whose bytes come as the test wants them."""

import pytest

from knotwork.core import clock
from knotwork.core.devices.dynamixel_bus import DynamixelBus
from knotwork.core.devices.errors import NoAnswer
from knotwork.core.protocols import dynamixel

MS = 1_000_000


class Port:
    """A device that answers a read of its control table; time passes only here."""

    path = "test"

    def __init__(self, script):
        self.now = 0
        self.script = script  # for each request: (ms until it is seen, bytes) of what arrives
        self.arriving = []
        self.requests = 0

    def write(self, data):
        if data.startswith(b"\xff\xff\xfd"):
            self.arriving = list(self.script[min(self.requests, len(self.script) - 1)])
            self.requests += 1

    def flush_input(self):
        return 0

    def read(self, timeout):
        if self.arriving and (self.arriving[0][0] * MS <= timeout * 1e9 or self.arriving[0][0] < 0):
            later, data = self.arriving.pop(0)
            self.now += abs(later) * MS  # negative: it was there in time, but the host looked so much later
            return data
        self.now += round(timeout * 1e9)
        return b""


@pytest.fixture
def ask(monkeypatch):
    def ask(*script):
        port = Port(script)
        monkeypatch.setattr(clock, "monotonic", lambda: port.now)
        bus = DynamixelBus(port)
        return bus, lambda: bus.read(7, 128, 4)

    return ask


ANSWER = dynamixel.status(7, 0, b"\x01\x02\x03\x04")


def test_an_answer_in_two_parts(ask):
    bus, read = ask([(1, ANSWER[:5]), (3, ANSWER[5:])])
    assert read() == b"\x01\x02\x03\x04"
    assert bus.retries == 0


def test_what_has_arrived_counts_though_the_host_has_paused(ask):
    bus, read = ask([(-400, ANSWER[:9]), (0, ANSWER[9:])])
    assert read() == b"\x01\x02\x03\x04"
    assert bus.retries == 0


def test_a_silent_device_is_asked_three_times(ask):
    bus, read = ask([])
    with pytest.raises(NoAnswer):
        read()
    assert (bus.retries, bus.failures, bus.port.requests) == (2, 1, 3)
    assert bus.port.now == 75 * MS


def test_a_device_that_talks_of_other_things_for_ever_does_not_hold_the_caller(ask):
    bus, read = ask([(5, b"noise")] * 100)
    with pytest.raises(NoAnswer):
        read()
    assert bus.port.now < 100 * MS


def test_a_lost_answer_is_asked_for_again(ask):
    bus, read = ask([], [(1, ANSWER)])
    assert read() == b"\x01\x02\x03\x04"
    assert bus.retries == 1
