"""Writes the path while the run goes on, and once more at the end where it was corrected."""

import math
from contextlib import suppress
from io import FileIO

from knotwork.core.contracts import Context, Sink
from knotwork.core.errors import KnotworkError
from knotwork.core.files import write_atomic
from knotwork.core.geometry import Pose2
from knotwork.core.messages import Message, Pose, Trajectory
from knotwork.plugins.sinks.trajectory import TrajectoryConfig
from knotwork.plugins.sinks.trajectory.numbers import ScanNumbers
from knotwork.plugins.sinks.trajectory.tum import line, stamp_of

_HINT = "free space on the disk or choose another folder with --out"


class _Path:
    """The poses of one stream, in the order of their first estimates."""

    def __init__(self) -> None:
        self.files: list[FileIO] = []  # as estimated, and the one that is corrected at the end
        self.scans = ScanNumbers()  # a line each
        self.corrections: dict[tuple[int, int], tuple[int, Pose2]] = {}  # (scan_id, stamp) -> revision, pose

    def correct(self, scan_id: int, stamp: int, revision: int, pose: Pose2) -> None:
        """Note a correction of a scan that has a line, unless it is known better."""
        first = self.scans.revision(scan_id)
        known = self.corrections.get((scan_id, stamp))
        if first is not None and revision >= (first if known is None else known[0]):
            self.corrections[scan_id, stamp] = revision, pose

    def corrected(self, text: str) -> str:
        """Return the lines of a file of first estimates with the corrections in it."""
        lines = text.splitlines(keepends=True)
        for i, (old, (scan_id, _)) in enumerate(zip(lines, self.scans, strict=False)):
            stamp = stamp_of(old)
            if known := self.corrections.get((scan_id, stamp)):
                lines[i] = line(stamp, *known[1])
        return "".join(lines)


class TrajectoryWriter(Sink):
    """Gives `NAME.online.tum`, each pose as first estimated, and `NAME.tum`, as corrected since.

    One line a scan, in the order of the log. Each line is in the files at once: a killed run keeps
    both, `NAME.tum` then without the later corrections. Only corrections are kept in memory.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._config: TrajectoryConfig = context.config
        self._paths: dict[str, _Path] = {}

    def on_message(self, stream: str, message: Message) -> None:
        """Write a pose, take the corrections of a trajectory."""
        if isinstance(message, Pose):
            if message.role == "estimate" and message.scan_id >= 0:
                self._add(stream, message)
        elif isinstance(message, Trajectory):
            self._supersede(message)

    def close(self) -> None:
        """Write the corrected path."""
        if not self._paths:
            self.context.report("warning", f"{self._config.name}.tum is not written: no pose of a scan came")
        paths, self._paths = self._paths, {}
        for stream, path in paths.items():
            for file in path.files:
                file.close()
            if path.corrections:
                file_of = self.context.out / f"{self._name(stream, list(paths))}.tum"
                write_atomic(file_of, path.corrected(file_of.read_text()).encode())

    def _add(self, stream: str, message: Pose) -> None:
        x, y, yaw = message.pose.tolist()
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(yaw)):
            self.context.count("invalid_poses")
            return
        path = self._paths.get(stream) or self._open(stream)
        if path.scans.revision(message.scan_id) is not None:
            path.correct(message.scan_id, message.stamp, message.revision, (x, y, yaw))
            return
        text = line(message.stamp, x, y, yaw).encode()
        for file in path.files:
            _write(file, text)
        path.scans.add(message.scan_id, message.revision)

    def _supersede(self, message: Trajectory) -> None:
        rows = zip(message.scan_ids.tolist(), message.stamps.tolist(), message.poses.tolist(), strict=True)
        for scan_id, stamp, (x, y, yaw) in rows:
            for path in self._paths.values():
                # The stamp tells apart scans of equal number from two sensors.
                path.correct(scan_id, stamp, message.revision, (x, y, yaw))

    def _open(self, stream: str) -> _Path:
        name = self._name(stream, [*self._paths, stream])
        path = _Path()
        for ending in (".online.tum", ".tum"):
            file = self.context.out / f"{name}{ending}"
            try:
                path.files.append(FileIO(file, "w"))  # unbuffered: what is written survives the process
            except OSError as error:
                for opened in path.files:
                    opened.close()
                raise KnotworkError(f"cannot write: {error.strerror}", where=str(file), hint=_HINT) from error
        self._paths[stream] = path
        return path

    def _name(self, stream: str, streams: list[str]) -> str:
        name = self._config.name
        return name if stream == streams[0] else f"{name}-{stream.replace('.', '-')}"


def _write(file: FileIO, data: bytes) -> None:
    """Write a whole line or nothing of it."""
    end = file.tell()
    try:
        while data:
            data = data[file.write(data) :]
    except OSError as error:
        with suppress(OSError):
            file.truncate(end)
            file.seek(end)
        raise KnotworkError(f"cannot write: {error.strerror}", where=str(file.name), hint=_HINT) from error
