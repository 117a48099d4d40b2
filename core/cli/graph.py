"""`knotwork graph FILE`: the nodes and wires of a pipeline, as text or Mermaid."""

import argparse
import sys

from knotwork.core import graph
from knotwork.core.cli import pipeline_file
from knotwork.core.registry import Registry


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add FILE, --set, --format."""
    pipeline_file.add_arguments(parser)
    parser.add_argument("--format", choices=("text", "mermaid"), default="text")


def run(arguments: argparse.Namespace) -> int:
    """Print the graph."""
    pipeline, wired = pipeline_file.load(arguments, Registry())
    render = graph.mermaid if arguments.format == "mermaid" else graph.text
    sys.stdout.write(render(wired, pipeline) + "\n")
    return 0
