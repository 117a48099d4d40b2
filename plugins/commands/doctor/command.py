"""The subcommand: examines, prints, and says by its exit code whether all is well."""

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from knotwork.core.contracts import Command
from knotwork.core.errors import InputError
from knotwork.plugins.commands.doctor import serial_devices, system
from knotwork.plugins.commands.doctor.finding import Finding


class Doctor(Command):
    """Returns 0 when nothing needs mending, else 1."""

    def arguments(self, parser: Any) -> None:
        """Add --port, --can and --json."""
        parser.add_argument(
            "--port", action="append", default=[], metavar="PATH", help="ask this serial device, known or not"
        )
        parser.add_argument(
            "--can", action="append", default=[], metavar="INTERFACE:CHANNEL", help="listen here, e.g. socketcan:can0"
        )
        parser.add_argument("--json", action="store_true", help="print the findings as JSON")

    def run(self, arguments: Any) -> int:
        """Examine everything and print it as it is found."""
        for text in arguments.can:
            if ":" not in text:
                raise InputError(f"expected INTERFACE:CHANNEL, got {text!r}", where="--can")
        found = []
        for finding in _examine(arguments.port, arguments.can):
            found.append(finding)
            if not arguments.json:
                sys.stdout.write(f"{finding}\n")
                sys.stdout.flush()
        if arguments.json:
            sys.stdout.write(json.dumps([asdict(f) for f in found], indent=2) + "\n")
        return int(any(f.level == "problem" for f in found))


def _examine(ports: list[str], can: list[str]) -> Iterator[Finding]:
    yield from system.examine_clock()
    yield from system.examine_programs()
    devices = serial_devices.devices(ports)
    if not devices and not can:
        yield Finding("problem", "serial", "no serial device is plugged in", "lidar and base connect by USB")
    for device in devices:
        yield from serial_devices.examine(device)
    yield from system.examine_can(can)
