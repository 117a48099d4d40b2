"""`knotwork config show FILE [--origin]`: what a pipeline file comes to, and where each value is from."""

import argparse
import sys

from knotwork.core import config
from knotwork.core.cli import pipeline_file
from knotwork.core.manifest import Manifest
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
    if arguments.action == "reference":
        sys.stdout.write(config.reference(_Shipped()))
        return 0
    pipeline = config.load(arguments.file, Registry(), overrides=arguments.overrides)
    sys.stdout.write(config.show(pipeline, origin=arguments.origin))
    return 0


class _Shipped:
    """All plugins that ship, also those whose extra is not installed here: the same text on every machine."""

    def __init__(self) -> None:
        records = Registry(third_parties=False).records()
        self._manifests = {r.name: r.manifest for r in records if r.manifest is not None}

    def find(self, name: str) -> Manifest | None:
        return self._manifests.get(name)

    def names(self, kind: str | None = None) -> list[str]:
        return [n for n, m in self._manifests.items() if kind is None or m.kind == kind]

    def why_not(self, name: str) -> str:
        return ""
