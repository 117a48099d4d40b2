"""List the data sets that can be fetched, with their licences."""

import sys
from typing import Any

from knotwork.plugins.commands.data.catalogue import add_argument, catalogue


def arguments(parser: Any) -> None:
    """Add the arguments."""
    add_argument(parser)


def run(arguments: Any) -> int:
    """Print a line or two for each."""
    for one in catalogue(arguments.catalogue).values():
        sys.stdout.write(f"{one.name}: {one.summary}\n")
        sys.stdout.write(f"    {', '.join(one.files)}; licence: {one.licence}\n")
    return 0
