"""Serial devices: which there are, whether one may use them, and what answers."""

import grp
import os
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from serial.tools import list_ports

from knotwork.core import clock
from knotwork.core.devices.dynamixel_bus import DynamixelBus, Refused
from knotwork.core.devices.errors import DeviceLost, NoAnswer
from knotwork.core.devices.serial_port import SerialPort
from knotwork.core.errors import DriverError
from knotwork.core.protocols import dynamixel, lds01, lds02, lds03, opencr, xl430
from knotwork.core.protocols.framing import StreamParser
from knotwork.core.protocols.registers import Register
from knotwork.plugins.commands.doctor.finding import Finding

# Adapters that a robot's devices come with; others are only asked when they are named.
KNOWN = {
    (0x10C4, 0xEA60): "CP2102 (a lidar's adapter)",
    (0x0483, 0x5740): "OpenCR board",
    (0x0403, 0x6014): "FT232H (U2D2)",
    (0x0403, 0x6001): "FT232R",
}
_LISTEN = 2.5  # s; an LDS-01 takes 2 s to spin up
_ENOUGH = 3  # packets
_BUS_WAIT = 0.4  # s for all motors to answer a broadcast
_BAUDS = (1_000_000, 57_600)
_LOW = 11.1  # V of a TurtleBot3's battery

P = TypeVar("P")


@dataclass(frozen=True, slots=True)
class Device:
    """A serial device: its path, and what its adapter is ("" when unknown)."""

    path: str
    adapter: str
    named: bool  # by the person


def devices(named: list[str]) -> list[Device]:
    """Return the named devices, else all that are there."""
    if named:
        return [Device(path, "", True) for path in named]
    found = []
    for port in list_ports.comports():
        if port.vid is not None:
            found.append(Device(port.device, KNOWN.get((port.vid, port.pid or 0), ""), False))
    return sorted(found, key=lambda device: device.path)


def examine(device: Device) -> Iterator[Finding]:
    """Yield what there is to say of a device."""
    path = device.path
    if not os.path.exists(path):
        yield Finding("problem", path, "no such device", "plug it in; `dmesg | tail` shows whether the kernel saw it")
        return
    name = device.adapter or ("a device" if device.named else "an unknown adapter")
    if not os.access(path, os.R_OK | os.W_OK):
        group = _group(path)
        yield Finding(
            "problem", path, f"{name}; you may not use it", f"sudo usermod -aG {group} $USER    # then log in again"
        )
        return
    yield from _latency_timer(path)
    if not device.adapter and not device.named:
        yield Finding("note", path, "an unknown adapter, not asked", f"knotwork doctor --port {path}    # asks it")
        return
    try:
        answers = list(_ask(path))
    except DriverError as error:
        yield Finding("problem", path, f"{name}; {error.message}", f"fuser -v {path}    # who has it open?")
        return
    except DeviceLost as lost:
        yield Finding("problem", path, f"{name}; {lost}")
        return
    if answers:
        yield from answers
    else:
        cure = "power, cable? a lidar must turn, a TurtleBot3 needs its battery and the ROS 2 firmware"
        yield Finding("problem", path, f"{name}; nothing known answers", cure)


def _ask(path: str) -> Iterator[Finding]:
    for ask in (_board, _motors, _lidar):
        found = list(ask(path))
        if found:
            yield from found
            return


def _board(path: str) -> Iterator[Finding]:
    with closing(SerialPort(path, opencr.BAUD)) as port:
        port.flush_input()
        bus = DynamixelBus(port)
        answer = bus.ping(opencr.DEVICE)
        if answer is None:
            return
        if answer[0] != opencr.MODEL_NUMBER:
            yield Finding("note", path, f"device 200 answers with model number {answer[0]}")
            return
        with suppress(NoAnswer):
            yield from _board_state(path, bus, answer[1])


def _board_state(path: str, bus: DynamixelBus, firmware: int) -> Iterator[Finding]:
    try:
        model = int(_number(bus, opencr.DEVICE, opencr.MODEL_INFORMATION))
    except Refused:
        model = 0
    names = {opencr.BURGER: "Burger", opencr.WAFFLE: "Waffle", opencr.WAFFLE_MANIPULATOR: "Waffle with arm"}
    voltage = _number(bus, opencr.DEVICE, opencr.BATTERY_VOLTAGE) * opencr.VOLTAGE_UNIT
    what = f"TurtleBot3 {names.get(model, 'of unknown kind')}, OpenCR firmware {firmware}, battery {voltage:.1f} V"
    yield Finding("ok", path, what, f"base: {{plugin: opencr, port: {_stable(path)}}}")
    if firmware < 5:
        yield Finding(
            "note", path, "this firmware may garble what it reads; the driver guards against it",
            "update it to 0.2.1: https://emanual.robotis.com/docs/en/platform/turtlebot3/opencr_setup/",
        )  # fmt: skip
    if _number(bus, opencr.DEVICE, opencr.DEVICE_STATUS) < 0:
        yield Finding("problem", path, "the board has found no motors", "switch the battery on, then press RESET")
    elif voltage < _LOW:
        yield Finding("problem", path, f"the battery is low ({voltage:.1f} V)", "charge it")


def _motors(path: str) -> Iterator[Finding]:
    for baud in _BAUDS:
        with closing(SerialPort(path, baud)) as port:
            port.flush_input()
            bus = DynamixelBus(port)
            port.write(dynamixel.ping(dynamixel.BROADCAST))
            found: dict[int, bytes] = {}
            until = clock.monotonic() + round(_BUS_WAIT * 1e9)
            while (left := until - clock.monotonic()) > 0:
                for packet in bus.parser.feed(port.read(left * 1e-9)):
                    if packet.is_status and len(packet.data) == 3:
                        found[packet.id] = packet.data
            for device, data in sorted(found.items()):
                with suppress(NoAnswer, Refused):
                    yield _motor(path, bus, device, data, baud)
            if found:
                return


def _motor(path: str, bus: DynamixelBus, device: int, data: bytes, baud: int) -> Finding:
    number = int.from_bytes(data[:2], "little")
    name = {xl430.XL430: "XL430", xl430.XM430: "XM430"}.get(number, f"model {number}")
    voltage = _number(bus, device, xl430.PRESENT_VOLTAGE) * xl430.VOLTAGE_UNIT
    error = int(_number(bus, device, xl430.HARDWARE_ERROR))
    text = f"{name}, id {device}, firmware {data[2]}, {baud} bit/s, {voltage:.1f} V"
    if error:
        names = ", ".join(name for bit, name in xl430.HARDWARE_ERRORS.items() if error & bit)
        return Finding("problem", path, f"{text}, hardware error: {names}", "cure the cause, then cycle its power")
    return Finding("ok", path, text, f"base: {{plugin: dynamixel-wheels, port: {_stable(path)}, baud: {baud}}}")


def _lidar(path: str) -> Iterator[Finding]:
    with closing(SerialPort(path, lds01.BAUD)) as port:
        port.write(lds01.START)
        first = lds01.Parser()
        packets = _listen(port, first)
        if packets:
            rpm = packets[-1].rpm
            yield Finding("ok", path, f"LDS-01, {rpm:.0f} rpm", f"lidar: {{plugin: lds01, port: {_stable(path)}}}")
            if not 290.0 <= rpm <= 310.0:
                yield Finding("problem", path, f"the lidar turns at {rpm:.0f} rpm, expected 300", "belt, dust, supply?")
            return
    with closing(SerialPort(path, lds02.BAUD)) as port:
        second = lds02.Parser()
        heard = _listen(port, second)
        if heard:
            turns = heard[-1].speed / 360.0
            yield Finding("ok", path, f"LDS-02, {turns:.1f} Hz", f"lidar: {{plugin: lds02, port: {_stable(path)}}}")
            return
    with closing(SerialPort(path, lds03.BAUD)) as port:
        port.write(lds03.START)
        if _listen(port, lds03.Parser()):
            port.write(lds03.STOP)
            cure = f"lidar: {{plugin: lds02, model: lds03, port: {_stable(path)}}}"
            yield Finding("ok", path, "LDS-03 (its driver is unproven)", cure)


def _listen(port: SerialPort, parser: StreamParser[P]) -> list[P]:
    packets: list[P] = []
    until = clock.monotonic() + round(_LISTEN * 1e9)
    while len(packets) < _ENOUGH and (left := until - clock.monotonic()) > 0:
        packets += parser.feed(port.read(left * 1e-9))
    return packets if len(packets) >= _ENOUGH else []


def _number(bus: DynamixelBus, device: int, register: Register) -> float:
    return register.unpack(bus.read(device, register.address, register.size), register.address)


def _group(path: str) -> str:
    try:
        return grp.getgrgid(os.stat(path).st_gid).gr_name
    except (OSError, KeyError):
        return "dialout"


def _stable(path: str) -> str:
    """Return a name that stays the same after replugging, if there is one."""
    for link in sorted(Path("/dev/serial/by-id").glob("*")):
        if os.path.realpath(link) == os.path.realpath(path):
            return str(link)
    return path


def _latency_timer(path: str) -> Iterator[Finding]:
    name = os.path.basename(os.path.realpath(path))
    file = Path("/sys/bus/usb-serial/devices") / name / "latency_timer"
    with suppress(OSError, ValueError):
        wait = int(file.read_text())
        if wait > 1:
            rule = 'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"'
            yield Finding(
                "problem", path, f"the adapter holds bytes back for up to {wait} ms",
                f"echo 1 | sudo tee {file}\n"
                f"echo '{rule}' | sudo tee /etc/udev/rules.d/99-latency.rules    # for good",
            )  # fmt: skip
