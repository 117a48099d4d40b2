"""`knotwork schema`: the JSON Schema of a pipeline file for the plugins installed here."""

import argparse
import json
import sys
from pathlib import Path

from knotwork.core import config
from knotwork.core.errors import InputError
from knotwork.core.registry import Registry


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add --out."""
    parser.add_argument("--out", metavar="FILE", help="write it there; an editor's first line then is shown")


def run(arguments: argparse.Namespace) -> int:
    """Print or write the schema."""
    text = json.dumps(config.json_schema(Registry()), indent=2) + "\n"
    if arguments.out is None:
        sys.stdout.write(text)
        return 0
    try:
        Path(arguments.out).write_text(text)
    except OSError as error:
        raise InputError(f"cannot write: {error.strerror}", where=arguments.out) from error
    sys.stdout.write(f"# yaml-language-server: $schema={arguments.out}\n")
    return 0
