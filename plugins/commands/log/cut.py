"""Write a part of a log: between two times, of some streams."""

import sys
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from knotwork.core.errors import InputError
from knotwork.core.log.edit import cut
from knotwork.core.log.reader import LogChannel


def arguments(parser: Any) -> None:
    """Add the arguments."""
    parser.add_argument("file", type=Path, metavar="FILE", help="the log; it is not changed")
    parser.add_argument("--from", dest="start", type=float, default=0.0, metavar="S", help="begin S seconds in")
    parser.add_argument("--to", dest="stop", type=float, metavar="S", help="end S seconds in")
    parser.add_argument(
        "--streams",
        nargs="+",
        metavar="PATTERN",
        help="only streams (`node.port`, with their views) and topics like this, with * and ?; /tf stays",
    )
    parser.add_argument("--output", type=Path, metavar="PATH", help="where to write instead of FILE.cut.mcap")


def run(arguments: Any) -> int:
    """Cut and say what was written."""
    patterns = arguments.streams
    if arguments.start < 0 or (arguments.stop is not None and arguments.stop <= arguments.start):
        raise InputError("expected 0 <= --from < --to", where="--to")

    def wanted(channel: LogChannel) -> bool:
        if channel.metadata.get("view") == "true" and "view_of" not in channel.metadata:
            return True  # shared by streams: the frames without which no viewer places what is kept
        names = (channel.stream, channel.topic, channel.metadata.get("view_of", "").rpartition("/knotwork/")[2])
        return not patterns or any(
            fnmatchcase(name.replace("/", "."), p.replace("/", ".")) for name in names if name for p in patterns
        )

    output = arguments.output or arguments.file.with_name(arguments.file.stem + ".cut.mcap")
    done = cut(arguments.file, output, start=arguments.start, stop=arguments.stop, wanted=wanted)
    sys.stdout.write("\n".join([f"{done.path}: {done.messages} messages", *(f"  {text}" for text in done.lost)]) + "\n")
    return 0
