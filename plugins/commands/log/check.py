"""Read a log through: checksums, indexes, order, every message; say what is wrong."""

import sys
from pathlib import Path
from typing import Any

from knotwork.core.log.check import check

_SHOWN = 20


def arguments(parser: Any) -> None:
    """Add the arguments."""
    parser.add_argument("file", type=Path, nargs="+", metavar="FILE", help="the log, or several")


def run(arguments: Any) -> int:
    """Check each; returns 1 when something is wrong with one."""
    code = 0
    for path in arguments.file:
        found = check(path)
        missing = f", {found.missing} dispatched messages are not in it" if found.missing else ""
        state = f"{len(found.problems)} problems" if found.problems else "sound"
        lines = [f"{path}: {state}; {found.messages} messages{missing}"]
        lines += [f"  {text}" for text in found.problems[:_SHOWN]]
        if len(found.problems) > _SHOWN:
            lines.append(f"  and {len(found.problems) - _SHOWN} more")
        sys.stdout.write("\n".join(lines) + "\n")
        code = code or int(bool(found.problems))
    return code
