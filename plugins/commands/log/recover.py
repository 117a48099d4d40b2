"""Write what can be read of a log that was cut short or damaged to FILE.recovered.mcap."""

import sys
from pathlib import Path
from typing import Any

from knotwork.core.log.recover import recover

_NOTES = 10  # lines about damage that are shown


def arguments(parser: Any) -> None:
    """Add the arguments."""
    parser.add_argument("file", type=Path, metavar="FILE", help="the log; it is not changed")
    parser.add_argument("--output", type=Path, metavar="PATH", help="where to write instead of FILE.recovered.mcap")


def run(arguments: Any) -> int:
    """Recover and say what was saved."""
    done = recover(arguments.file, arguments.output)
    damage = done.damage
    lines = [f"{done.path}: {done.messages} messages"]
    if damage.complete and not damage.lost_bytes and not done.orphans:
        lines.append("the log was whole")
    else:
        state = "its end was there" if damage.complete else "it was cut short"
        lines.append(
            f"{state}; skipped: {damage.lost_bytes} bytes, {damage.damaged_chunks} damaged chunks, "
            f"{damage.damaged_records} other records, {done.orphans} messages of lost channels"
        )
        lines += [f"  {note}" for note in damage.notes[:_NOTES]]
        if len(damage.notes) > _NOTES:
            lines.append(f"  and {len(damage.notes) - _NOTES} more")
    sys.stdout.write("\n".join(lines) + "\n")
    return 0
