"""Say what a recording is: its format, what it holds, its checksum."""

import sys
from pathlib import Path
from typing import Any

from knotwork.core.playback.recording import Recording
from knotwork.plugins.commands.data.fetch import sha256
from knotwork.plugins.commands.data.formats import recognise


def arguments(parser: Any) -> None:
    """Add the arguments."""
    parser.add_argument("file", type=Path, metavar="FILE", help="a recording: MCAP, ROS bag, CARMEN log, ...")


def run(arguments: Any) -> int:
    """Print what is known of it."""
    path: Path = arguments.file
    found = recognise(path)
    files = [path] if path.is_file() else sorted(p for p in path.iterdir() if p.is_file())
    size = sum(p.stat().st_size for p in files) / 1e6
    lines = [f"{path}: {found.name}, {size:.2f} MB, read by `{found.driver}`"]
    recording = _opened(found.driver, path)
    if recording is not None:
        lines.append(f"{(recording.end - recording.start) / 1e9:.3f} s, from {recording.start / 1e9:.3f}")
        for track in recording.tracks.values():
            lines.append(f"  {track.topic}  {track.type}{f' ({track.role})' if track.role else ''}  {track.count}")
        lines += [f"  {topic}  {kind}  not understood" for topic, kind in recording.other.items()]
        recording.close()
    lines += [f"sha256 {sha256(p)}  {p.name}" for p in files]
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def _opened(driver: str, path: Path) -> Recording | None:
    if driver == "mcap-log":
        from knotwork.core.playback.mcap import McapRecording

        return McapRecording(str(path))
    if driver == "rawlog":
        from knotwork.core.playback.rawlog import RawlogRecording

        return RawlogRecording(str(path))
    if driver == "rosbag":
        try:
            from knotwork.core.playback.rosbag import RosbagRecording
        except ModuleNotFoundError as error:
            sys.stderr.write(f"its topics need {error.name}: pip install 'knotwork[ros]'\n")
            return None
        return RosbagRecording(str(path))
    return None
