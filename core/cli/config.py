"""`knotwork config show FILE [--origin]`: what a pipeline file comes to, and where each value is from."""

import argparse
import sys

from knotwork.core import config
from knotwork.core.cli import pipeline_file
from knotwork.core.registry import Registry


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add `show` and `reference`."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="show | reference")
    show = actions.add_parser("show", help="print the resolved configuration")
    pipeline_file.add_arguments(show)
    show.add_argument("--origin", action="store_true", help="say where each value comes from")
    actions.add_parser("reference", help="print the reference of all plugins' keys (Markdown)")


def run(arguments: argparse.Namespace) -> int:
    """Print it."""
    registry = Registry()
    if arguments.action == "reference":
        sys.stdout.write(config.reference(registry))
        return 0
    pipeline = config.load(arguments.file, registry, overrides=arguments.overrides)
    sys.stdout.write(config.show(pipeline, origin=arguments.origin))
    return 0
