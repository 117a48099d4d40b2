"""One run in a process of its own: a pipeline in, figures and files out, all of it plain data."""

import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from knotwork.core import config, graph
from knotwork.core.cli.run import header
from knotwork.core.contracts import Level
from knotwork.core.errors import KnotworkError
from knotwork.core.evaluation.tum import tum_line
from knotwork.core.geometry import Pose2, relative
from knotwork.core.messages import UNSET, Grid, Message, Pose, Scan, Trajectory
from knotwork.core.registry import Registry
from knotwork.core.runtime import Result
from knotwork.core.runtime import Run as Execution


@dataclass(frozen=True, slots=True)
class Job:
    """A pipeline and the folder its own sinks write to."""

    pipeline: config.Pipeline
    out: str


@dataclass(slots=True)
class Outcome:
    """What a run gave: `data` goes into result.json, `files` beside it."""

    error: str
    data: dict[str, Any] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)


def execute(job: Job) -> Outcome:
    """Run a pipeline; what goes wrong is in the outcome."""
    try:
        return _execute(job)
    except KnotworkError as error:
        return Outcome(str(error))


def _execute(job: Job) -> Outcome:
    registry = Registry()
    pipeline = job.pipeline
    collector = Collector()
    reports: list[str] = []

    def report(node: str, level: Level, text: str) -> None:
        reports.append(f"{level}: {node}: {text}")

    run = Execution(
        pipeline,
        graph.build(pipeline),
        registry,
        Path(job.out),
        console=report,
        header=header(pipeline, registry),
    )
    run.tap(collector.take)
    result = run.execute()
    error = ""
    if result.failure is not None:
        error = _placed(str(result.failure), pipeline)
    elif result.exit_code:
        error = next((line for line in reversed(reports) if line.startswith("error")), "the run reported an error")
    data = figures(pipeline, result, collector)
    ending = f"failed: {result.failure}\n{result.trace}" if result.failure else "done\n"
    log = "".join(f"{line}\n" for line in reports) + ending
    files = collector.files() | {"config.yaml": config.show(pipeline).encode(), "run.log": log.encode()}
    return Outcome(error, data, files)


def _placed(failure: str, pipeline: config.Pipeline) -> str:
    """Put where the node's file was named before its failure: that is what mostly is wrong."""
    node = failure.removeprefix("node ").partition(":")[0] if failure.startswith("node ") else ""
    if node not in pipeline.nodes:
        return failure
    origin = pipeline.origins.get(f"nodes.{node}.path")
    return f"{origin or pipeline.where(f'nodes.{node}')}: {failure}"


def figures(pipeline: config.Pipeline, result: Result, collector: "Collector") -> dict[str, Any]:
    """Return what result.json holds of a run: times [ms] a scan, speed relative to the sensor, bytes, statistics."""
    nodes = result.statistics["nodes"]
    localizers = [name for name, spec in pipeline.nodes.items() if spec.manifest.kind == "localizer"]
    rows = [nodes[name] for name in localizers if nodes.get(name, {}).get("n")]
    scans = sum(row["n"] for row in rows)
    update = sum(nodes.get(f"{name}.update", {}).get("total_ms", 0.0) for name in localizers) / scans if scans else None
    whole = sum(row["total_ms"] for row in rows) / scans if scans else None
    wall = result.statistics["wall_s"]
    duration = (collector.last - collector.first) / 1e9
    return {
        "scans": collector.scans,
        "lost_scans": len(collector.lost),
        "path_m": collector.path(),
        "log_duration_s": duration,
        "localise_ms": None if whole is None or update is None else whole - update,
        "update_ms": update,
        "scan_ms": whole,
        "speed": duration / wall if wall and scans else None,
        "map_bytes": sum(collector.map_bytes.values()) if collector.map_bytes else None,
        "statistics": result.statistics,
    }


class Collector:
    """Keeps of all messages what the comparison needs; of several nodes that give poses or grids the first one's."""

    def __init__(self) -> None:
        self.scans = 0
        self.lost: set[int] = set()
        self.first = UNSET
        self.last = UNSET
        self.map_bytes: dict[str, int] = {}
        self.estimates: dict[int, tuple[int, Pose2]] = {}  # scan_id: stamp, pose
        self.truths: dict[int, tuple[int, Pose2]] = {}  # seen from the first, where the map's frame begins
        self.grid: Grid | None = None
        self._streams: dict[str, str] = {}
        self._origin: Pose2 | None = None

    def take(self, stream: str, message: Message) -> None:
        """Take one message of the run."""
        if isinstance(message, Scan):
            self.scans += 1
            self.first = message.time if self.first == UNSET else self.first
            self.last = message.time
        elif isinstance(message, Pose):
            self._pose(stream, message)
        elif isinstance(message, Trajectory):
            rows = zip(message.scan_ids.tolist(), message.poses.tolist(), strict=True)
            for scan_id, (x, y, yaw) in rows:
                if scan_id in self.estimates:
                    self.estimates[scan_id] = (self.estimates[scan_id][0], (x, y, yaw))
        elif isinstance(message, Grid):
            self.map_bytes[stream] = message.map_bytes
            if self._streams.setdefault("grid", stream) == stream:
                self.grid = message

    def _pose(self, stream: str, message: Pose) -> None:
        if message.scan_id < 0 or message.role == "prior":
            return
        x, y, yaw = message.pose.tolist()
        if message.role == "truth":
            self._origin = self._origin or (x, y, yaw)
            self.truths[message.scan_id] = (message.stamp, relative(self._origin, (x, y, yaw)))
        elif self._streams.setdefault("estimate", stream) == stream:
            if message.lost:
                self.lost.add(message.scan_id)
            self.estimates[message.scan_id] = (message.stamp, (x, y, yaw))

    def path(self) -> float:
        """Return the length of the estimated path [m]."""
        points = np.array([pose[:2] for _, pose in self.estimates.values()]).reshape(-1, 2)
        return float(np.hypot(*np.diff(points, axis=0).T).sum()) if len(points) > 1 else 0.0

    def files(self) -> dict[str, bytes]:
        """Return trajectory.tum and map.npz, and pairs of scans with a true pose: truth.tum, estimate.tum."""
        files: dict[str, bytes] = {}
        if self.estimates:
            files["trajectory.tum"] = _tum(self.estimates, list(self.estimates))
        both = [scan_id for scan_id in self.estimates if scan_id in self.truths and scan_id not in self.lost]
        if both:
            files["truth.tum"] = _tum(self.truths, both)
            files["estimate.tum"] = _tum(self.estimates, both)
        if self.grid is not None:
            archive = io.BytesIO()
            frame = np.array((self.grid.resolution, *self.grid.origin))
            np.savez_compressed(archive, cells=self.grid.cells, frame=frame)
            files["map.npz"] = archive.getvalue()
        return files


def _tum(poses: dict[int, tuple[int, Pose2]], scans: list[int]) -> bytes:
    return "".join(f"{tum_line(*poses[scan_id])}\n" for scan_id in scans).encode()
