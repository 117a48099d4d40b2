"""`knotwork validate FILE`: everything that can be checked without opening a device."""

import argparse
import sys

from knotwork.core.cli import pipeline_file
from knotwork.core.registry import Registry

arguments = pipeline_file.add_arguments


def run(arguments: argparse.Namespace) -> int:
    """Print `ok` with what was found, and the legal cycles; problems end in a ConfigError."""
    pipeline, wired = pipeline_file.load(arguments, Registry())
    out = sys.stdout.write
    out(f"ok: {pipeline.name}: {len(pipeline.nodes)} nodes, {len(wired.edges)} wires, clock {wired.clock}\n")
    for cycle in wired.cycles:
        out(f"cycle: {' -> '.join([*cycle, cycle[0]])}\n")
    return 0
