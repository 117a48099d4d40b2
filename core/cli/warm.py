"""`knotwork warm [FILE]`: compile the kernels of a pipeline (of all shipped pipelines without one) now."""

import argparse
import sys
import tempfile
from importlib.resources import files
from pathlib import Path

from knotwork.core import config, graph
from knotwork.core.errors import KnotworkError
from knotwork.core.registry import Registry


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add FILE."""
    parser.add_argument("file", metavar="FILE", nargs="?", help="pipeline file; all that ship without it")


def run(arguments: argparse.Namespace) -> int:
    """Build and warm each node once; opens nothing."""
    from knotwork.core.runtime import Run

    registry = Registry()
    shipped = sorted(f.name for f in files("knotwork.configs").iterdir() if f.name.endswith(".yaml"))
    names = [arguments.file] if arguments.file else [f"configs:{name}" for name in shipped]
    for name in names:
        try:
            pipeline = config.load(name, registry)
            with tempfile.TemporaryDirectory() as out:
                Run(pipeline, graph.build(pipeline), registry, Path(out)).warm()
        except KnotworkError as error:
            if arguments.file:
                raise
            sys.stderr.write(f"{name}: {error}\n")
            continue
        sys.stdout.write(f"{name}: ready\n")
    return 0
