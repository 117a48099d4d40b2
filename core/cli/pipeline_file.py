"""What the subcommands that take a pipeline file share."""

import argparse
from typing import TYPE_CHECKING

from knotwork.core import config, graph
from knotwork.core.registry import Registry

if TYPE_CHECKING:
    from knotwork.core.config import Pipeline


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add FILE and --set."""
    parser.add_argument("file", metavar="FILE", help="pipeline file (YAML); configs:NAME for one that ships")
    parser.add_argument(
        "--set",
        dest="overrides",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="override one value, e.g. nodes.map.plugin=grid or vars.log=my.clf; may be repeated",
    )


def load(arguments: argparse.Namespace, registry: Registry) -> "tuple[Pipeline, graph.Graph]":
    """Load and wire the file that the arguments name."""
    pipeline = config.load(arguments.file, registry, overrides=arguments.overrides)
    return pipeline, graph.build(pipeline)
