"""The subcommands of `knotwork map`."""

import json
import sys
from pathlib import Path
from typing import Any

from knotwork.core.contracts import Command
from knotwork.core.errors import InputError
from knotwork.core.map_file import describe_map
from knotwork.plugins.commands.map import convert


class MapCommand(Command):
    """`knotwork map info | convert FILE`."""

    def arguments(self, parser: Any) -> None:
        """Add a subparser for each subcommand."""
        forms = parser.add_subparsers(dest="form", metavar="COMMAND", required=True)
        form = forms.add_parser("info", help="plugin, version, resolution and config of the map, as JSON")
        form.add_argument("file", type=Path, metavar="FILE", help="what a map saved")
        form = forms.add_parser("convert", help="write the map in another format, beside FILE or elsewhere")
        form.add_argument("file", type=Path, metavar="FILE", help="what a map saved")
        form.add_argument(
            "--to",
            choices=convert.FORMATS,
            required=True,
            help="pgm: map.pgm and map.yaml for navigation stacks; png: a picture; svg: outlines of curves",
        )
        form.add_argument("--output", type=Path, metavar="PATH", help="instead of FILE with the new ending")
        form.add_argument("--resolution", type=float, metavar="M", help="cells of pgm and png; default: the map's")

    def run(self, arguments: Any) -> int:
        """Run the chosen one."""
        if arguments.form == "info":
            kind, version, facts = describe_map(arguments.file)
            text = json.dumps({"plugin": kind, "version": version, **facts}, indent=2, sort_keys=True)
            sys.stdout.write(text + "\n")
            return 0
        if arguments.resolution is not None and not 1e-3 <= arguments.resolution <= 100.0:
            raise InputError(f"expected 0.001 to 100 m, found {arguments.resolution:g}", where="--resolution")
        output = arguments.output or arguments.file.with_suffix(f".{arguments.to}")
        for path in convert.convert(arguments.file, arguments.to, output, arguments.resolution):
            sys.stdout.write(f"{path}\n")
        return 0
