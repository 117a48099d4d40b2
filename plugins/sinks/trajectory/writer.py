"""Writes the path while the run goes on, and once more at the end where it was corrected."""

import math
from io import FileIO

from knotwork.core.contracts import Context, Sink
from knotwork.core.errors import KnotworkError
from knotwork.core.files import write_atomic
from knotwork.core.messages import Message, Pose, Trajectory
from knotwork.plugins.sinks.trajectory import TrajectoryConfig
from knotwork.plugins.sinks.trajectory.tum import line

_HINT = "free space on the disk or choose another folder with --out"


class _Path:
    """The poses of one stream by scan, in the order of its first estimates."""

    def __init__(self) -> None:
        self.files: list[FileIO] = []  # as estimated, and the one that is corrected at the end
        self.lines: dict[int, tuple[int, int, str]] = {}  # scan_id -> revision, stamp, line
        self.changed = False


class TrajectoryWriter(Sink):
    """Gives `NAME.online.tum`, each pose as first estimated, and `NAME.tum`, as corrected since.

    One line a scan, in the order of the log. Each line is in the files at once: a killed run keeps
    both, `NAME.tum` then without the later corrections.
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
            if path.changed:
                text = "".join(text for _, _, text in path.lines.values())
                write_atomic(self.context.out / f"{self._name(stream, list(paths))}.tum", text.encode())

    def _add(self, stream: str, message: Pose) -> None:
        x, y, yaw = message.pose.tolist()
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(yaw)):
            self.context.count("invalid_poses")
            return
        path = self._paths.get(stream) or self._open(stream)
        text = line(message.stamp, x, y, yaw)
        known = path.lines.get(message.scan_id)
        if known is None:
            path.lines[message.scan_id] = (message.revision, message.stamp, text)
            for file in path.files:
                _write(file, text.encode())
        elif message.revision >= known[0]:
            path.lines[message.scan_id] = (message.revision, known[1], line(known[1], x, y, yaw))
            path.changed = True

    def _supersede(self, message: Trajectory) -> None:
        rows = zip(message.scan_ids.tolist(), message.stamps.tolist(), message.poses.tolist(), strict=True)
        for scan_id, stamp, (x, y, yaw) in rows:
            for path in self._paths.values():
                known = path.lines.get(scan_id)
                # The stamp tells apart scans of equal number from two sensors.
                if known and known[0] <= message.revision and known[1] == stamp:
                    path.lines[scan_id] = (message.revision, stamp, line(stamp, x, y, yaw))
                    path.changed = True

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
    try:
        while data:
            data = data[file.write(data) :]
    except OSError as error:
        raise KnotworkError(f"cannot write: {error.strerror}", where=str(file.name), hint=_HINT) from error
