"""Write several logs as one, by log time; the parts of a split run become one log again."""

import sys
from pathlib import Path
from typing import Any

from knotwork.core.log.edit import merge


def arguments(parser: Any) -> None:
    """Add the arguments."""
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE", help="the logs; they are not changed")
    parser.add_argument("--output", type=Path, required=True, metavar="PATH", help="where to write")


def run(arguments: Any) -> int:
    """Merge and say what was written."""
    done = merge(arguments.files, arguments.output)
    sys.stdout.write("\n".join([f"{done.path}: {done.messages} messages", *(f"  {text}" for text in done.lost)]) + "\n")
    return 0
