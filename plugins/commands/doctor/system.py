"""The computer itself: its clock, its CAN interfaces, programs that get in the way."""

import importlib.util
import time
from collections.abc import Iterator
from pathlib import Path

from knotwork.core import clock
from knotwork.plugins.commands.doctor.finding import Finding

_CAN_TYPE = "280"  # of /sys/class/net/*/type
_LISTEN = 0.5  # s
_EPOCH_2024 = 1_704_067_200


def examine_clock() -> Iterator[Finding]:
    """Yield whether the clock can be right; a Raspberry Pi forgets the time without power."""
    today = time.strftime("%Y-%m-%d %H:%M", time.gmtime(clock.epoch() * 1e-9))
    if clock.epoch() * 1e-9 < _EPOCH_2024:
        yield Finding("problem", "clock", f"it says {today} UTC", "sudo timedatectl set-ntp true    # with a network")
    else:
        yield Finding("ok", "clock", f"{today} UTC")


def examine_programs() -> Iterator[Finding]:
    """Yield programs that open serial devices by themselves."""
    for file in Path("/proc").glob("[0-9]*/comm"):
        try:
            name = file.read_text().strip()
        except OSError:
            continue
        if name == "ModemManager":
            rule = 'ATTRS{idVendor}=="0483", ATTRS{idProduct}=="5740", ENV{ID_MM_DEVICE_IGNORE}="1"'
            yield Finding(
                "problem", name, "it talks to a new OpenCR board as if it were a modem",
                f"echo '{rule}' | sudo tee /etc/udev/rules.d/99-opencr.rules    # or: sudo apt remove modemmanager",
            )  # fmt: skip


def examine_can(named: list[str]) -> Iterator[Finding]:
    """Yield the CAN interfaces of this computer, or the named ones (`interface:channel`), and who is there."""
    for text in named:
        interface, _, channel = text.partition(":")
        yield from _listen(interface, channel)
    for folder in sorted(Path("/sys/class/net").glob("*")) if not named else ():
        try:
            if (folder / "type").read_text().strip() != _CAN_TYPE:
                continue
            up = int((folder / "flags").read_text(), 16) & 1
        except (OSError, ValueError):
            continue
        if up:
            yield from _listen("socketcan", folder.name)
        else:
            cure = f"sudo ip link set {folder.name} up type can bitrate 500000"
            yield Finding("problem", folder.name, "a CAN interface that is down", cure)


def _listen(interface: str, channel: str) -> Iterator[Finding]:
    what = f"{interface} {channel}"
    if any(importlib.util.find_spec(name) is None for name in ("can", "cantools")):
        yield Finding("problem", what, "python-can and cantools are not installed", "pip install 'knotwork[can]'")
        return
    import can

    from knotwork.core.protocols import agilex

    try:
        bus = can.Bus(interface=interface, channel=channel)
    except (can.CanError, OSError, ValueError, NotImplementedError) as error:
        yield Finding("problem", what, f"cannot be opened: {error}")
        return
    decoder = agilex.Decoder()
    voltage = 0.0
    until = clock.monotonic() + round(_LISTEN * 1e9)
    try:
        while (left := until - clock.monotonic()) > 0:
            message = bus.recv(left * 1e-9)
            frame = decoder.decode(message.arbitration_id, message.data) if message is not None else None
            if frame is not None and frame.name == "SystemState":
                voltage = frame.signals["battery"]
                break
    finally:
        bus.shutdown()
    if voltage:
        cure = f"base: {{plugin: can-base, interface: {interface}, channel: {channel}}}"
        yield Finding("ok", what, f"AgileX base, {voltage:.1f} V", cure)
    elif decoder.received:
        yield Finding("note", what, f"{decoder.received} frames, none of an AgileX base")
    else:
        yield Finding("problem", what, "nobody speaks", "power, termination, bit rate (AgileX: 500 kbit/s)?")
