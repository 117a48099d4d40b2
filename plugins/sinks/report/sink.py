"""Keeps what the report needs and writes it at the end."""

from knotwork.core.contracts import Context, Sink
from knotwork.core.files import write_atomic
from knotwork.core.messages import UNSET, Event, Grid, Message, Pose, Scan, Statistics, Trajectory
from knotwork.plugins.sinks.report import ReportConfig
from knotwork.plugins.sinks.report.errors import Poses
from knotwork.plugins.sinks.report.page import Story, page


class Report(Sink):
    """Writes the page with the run's last statistics, or when it is closed without them."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._config: ReportConfig = context.config
        self._story = Story(context.run)
        self._written = False

    def on_message(self, stream: str, message: Message) -> None:
        """Keep what is told of it."""
        story = self._story
        if isinstance(message, Statistics):
            story.statistics = message.data
            story.complete = message.final
            if message.final:
                self._write()
            return
        if isinstance(message, Event):
            if message.level in ("warning", "error"):
                story.events_in_all += 1
                if len(story.events) < self._config.events:
                    story.events.append((message.level, message.node, message.text))
            return
        if story.first == UNSET:
            story.first = message.time
        story.last = max(story.last, message.time)
        if isinstance(message, Scan):
            story.scans += 1
        elif isinstance(message, Pose):
            self._on_pose(stream, message)
        elif isinstance(message, Trajectory):
            rows = zip(message.scan_ids.tolist(), message.stamps.tolist(), message.poses.tolist(), strict=True)
            for scan, stamp, (x, y, yaw) in rows:
                for poses in story.estimates.values():
                    if scan in poses.poses:
                        poses.add(scan, stamp, (x, y, yaw))
        elif isinstance(message, Grid):
            story.grids[stream] = message

    def close(self) -> None:
        """Write what is known, if the run's last statistics did not come."""
        if not self._written:
            self._write()

    def _on_pose(self, stream: str, message: Pose) -> None:
        story = self._story
        if message.role == "prior" or message.scan_id < 0:
            return
        if message.lost:
            story.lost += 1
            return
        x, y, yaw = message.pose.tolist()
        kept = story.estimates if message.role == "estimate" else story.truths
        kept.setdefault(stream, Poses()).add(message.scan_id, message.stamp, (x, y, yaw))

    def _write(self) -> None:
        self._written = True
        text, wrong = page(self._story, self._config)
        write_atomic(self.context.out / f"{self._config.name}.html", text.encode())
        for line in wrong:
            self.context.report("error", line)
