"""Which format a recording has, told by its content, and which driver reads it."""

import gzip
import lzma
from dataclasses import dataclass
from pathlib import Path

from knotwork.core.errors import InputError

_HEAD = 1 << 16  # bytes that are looked at
_LASERS = (b"FLASER ", b"RLASER ", b"ROBOTLASER1 ", b"ODOM ")
_RAWLOG = (b"mrpt::obs::", b"CObservation", b"CSensoryFrame", b"CActionCollection", b"CPose")


@dataclass(frozen=True, slots=True)
class Format:
    """A format in words, and the driver plugin that reads it."""

    name: str
    driver: str


def recognise(path: Path) -> Format:
    """Return the format of a recording.

    Raises
    ------
    InputError
        There is no such file, or it is none of the known formats.
    """
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return Format("ROS 2 bag", "rosbag")
        raise InputError("a folder, but no ROS 2 bag (it has no metadata.yaml)", where=str(path))
    head = _head(path)
    if head.startswith(b"\x89MCAP0\r\n"):
        return Format("MCAP", "mcap-log")
    if head.startswith(b"#ROSBAG V2.0"):
        return Format("ROS 1 bag", "rosbag")
    if head.startswith(b"SQLite format 3\0"):
        return Format("ROS 2 bag (sqlite3)", "rosbag")
    if any(name in head[:200] for name in _RAWLOG):
        return Format("MRPT rawlog", "rawlog")
    lines = [line for line in head.splitlines()[:-1] if line.strip() and not line.startswith(b"#")]
    if any(line.startswith(_LASERS) for line in lines):
        return Format("CARMEN log", "carmen")
    if lines and all(_numbers(line) == 366 for line in lines[:3]):
        return Format("text log of a simulated TurtleBot3 in Gazebo", "gazebo-text")
    if lines and all(_numbers(line) == 707 for line in lines[:3]):
        return Format("MinesRover log", "minesrover")
    raise InputError(
        "none of the known formats: MCAP, ROS bag, MRPT rawlog, CARMEN log, Gazebo text, MinesRover", where=str(path)
    )


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            head = file.read(6)
        if head.startswith(b"\x1f\x8b"):
            with gzip.open(path) as packed:
                return packed.read(_HEAD)
        if head.startswith(b"\xfd7zXZ\x00"):
            with lzma.open(path) as packed:
                return packed.read(_HEAD)
        with path.open("rb") as file:
            return file.read(_HEAD)
    except FileNotFoundError:
        raise InputError("no such file", where=str(path), hint="check the path") from None
    except (OSError, EOFError, lzma.LZMAError) as error:
        raise InputError(f"cannot be read: {error}", where=str(path)) from error


def _numbers(line: bytes) -> int:
    fields = line.split()
    try:
        [float(field) for field in fields]
    except ValueError:
        return 0
    return len(fields)
