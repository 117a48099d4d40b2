"""What a page shows of a run: the newest of everything, the paths, the map's tiles.

Messages come in at the run's pace, looks go out at the page's: between two looks only the newest scan
counts, and nothing is encoded for nobody.
"""

import math
from collections import deque
from collections.abc import Callable
from threading import Lock
from typing import Any

from knotwork.core import messages as m
from knotwork.core.geometry import Pose2, relative
from knotwork.core.live import render
from knotwork.core.live.paths import Path
from knotwork.core.live.tiles import Tiles

_EVENTS = 200  # lines kept
_IMAGES_EVERY = 5  # looks between pictures of a camera
_SCANS_PLACED = 64  # estimates kept until their scan's turn

Look = dict[str, Any]


class Scene:
    """Takes messages in one thread and gives looks in another.

    Attributes
    ----------
    extra
        Called for each look; returns more entries of it.
    """

    def __init__(self, extra: Callable[[], Look] = dict) -> None:
        self.extra = extra
        self._lock = Lock()
        self._clear()

    def _clear(self) -> None:
        self._time = m.UNSET
        self._newest: dict[str, m.Message] = {}  # by stream
        self._changed: set[str] = set()
        self._counts: dict[str, int] = {}
        self._paths: dict[str, Path] = {}
        self._maps: dict[str, Tiles] = {}
        self._poses: dict[tuple[str, int], Pose2] = {}  # estimates by stream and scan
        self._priors: deque[m.Pose] = deque(maxlen=_SCANS_PLACED)
        self._before: dict[str, m.Pose] = {}  # what was expected of the newest estimate, by its stream
        self._events: deque[list[Any]] = deque(maxlen=_EVENTS)
        self._new_events = 0
        self._truth_origin: Pose2 | None = None
        self._looks = 0

    def reset(self) -> None:
        """Forget everything; the next look at it must be `everything`."""
        with self._lock:
            self._clear()

    def take(self, stream: str, message: m.Message) -> None:
        """Take a message of the stream `node.port`."""
        with self._lock:
            self._time = max(self._time, message.time)
            self._counts[stream] = self._counts.get(stream, 0) + 1
            if isinstance(message, m.Event):
                self._events.append([message.level, message.node, message.text, message.time / 1e9])
                self._new_events += 1
                return
            if isinstance(message, m.Pose):
                self._on_pose(stream, message)
            elif isinstance(message, m.Trajectory):
                self._on_trajectory(message)
            elif isinstance(message, m.Grid):
                self._maps.setdefault(stream, Tiles()).update(message)
                return
            self._newest[stream] = message
            self._changed.add(stream)

    def changes(self) -> Look:
        """Return what is new since the last call."""
        extra = self.extra()
        with self._lock:
            streams, self._changed = self._changed, set()
            self._looks += 1
            events = list(self._events)[-self._new_events :] if self._new_events else []
            self._new_events = 0
            maps = {stream: changed for stream, tiles in self._maps.items() if (changed := tiles.changes())}
            paths = {stream: new for stream, path in self._paths.items() if (new := path.changes())}
            return self._look(streams, events, maps, paths) | extra

    def everything(self) -> Look:
        """Return all there is, for a page that has nothing."""
        extra = self.extra()
        with self._lock:
            maps = {stream: tiles.everything() for stream, tiles in self._maps.items()}
            paths = {stream: path.everything() for stream, path in self._paths.items()}
            look = self._look(set(self._newest), list(self._events), maps, paths, images=True)
            return look | {"reset": True} | extra

    def _look(self, streams: set[str], events: Any, maps: Look, paths: Look, images: bool = False) -> Look:
        out: Look = {"time": self._time / 1e9, "counts": dict(self._counts)}
        out |= {name: value for name, value in (("events", events), ("maps", maps), ("paths", paths)) if value}
        later = set()
        for stream in sorted(streams):
            message = self._newest[stream]
            if isinstance(message, m.Image) and not images and self._looks % _IMAGES_EVERY:
                later.add(stream)
                continue
            section, value = self._render(stream, message)
            if section:
                out.setdefault(section, {})[stream] = value
        self._changed |= later
        return out

    def _render(self, stream: str, message: m.Message) -> tuple[str, Any]:
        if isinstance(message, m.Scan):
            return "scans", render.scan(message, self._place(message))
        if isinstance(message, m.Pose):
            if message.role == "truth" and self._truth_origin is not None:
                return "poses", render.pose(message, self._from_truth(message.pose.tolist()))
            shown = render.pose(message, tuple(message.pose.tolist()))
            before = self._before.get(stream)
            if before is not None:
                shown["prior"] = render.pose(before, tuple(before.pose.tolist()))
            return "poses", shown
        call = render.SECTIONS.get(type(message))
        return (call[0], call[1](message)) if call else ("", None)

    def _on_pose(self, stream: str, message: m.Pose) -> None:
        x, y, yaw = message.pose.tolist()
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(yaw)):
            return
        at: Pose2 = (x, y, yaw)
        if message.role == "truth":
            if self._truth_origin is None:
                self._truth_origin = at
            at = self._from_truth(at)
        if message.role == "prior":
            self._priors.append(message)
        elif message.role == "estimate":
            self._expect(stream, message)
        if message.role == "prior" or message.lost:
            return
        path = self._paths.get(stream)
        if path is None:
            path = self._paths[stream] = Path(message.role)
        path.add(message.scan_id, at)
        if message.role == "estimate" and message.scan_id >= 0:
            self._poses[stream, message.scan_id] = at
            while len(self._poses) > _SCANS_PLACED:
                del self._poses[next(iter(self._poses))]

    def _expect(self, stream: str, estimate: m.Pose) -> None:
        """Find the newest prior that is not after an estimate's measurement."""
        fitting = [prior for prior in self._priors if prior.stamp <= estimate.stamp]
        if fitting:
            self._before[stream] = max(fitting, key=lambda prior: prior.stamp)

    def _on_trajectory(self, message: m.Trajectory) -> None:
        scans, poses = message.scan_ids.tolist(), message.poses.tolist()
        for path in self._paths.values():
            if path.role == "estimate":
                path.correct(dict(zip(scans, poses, strict=True)))

    def _place(self, scan: m.Scan) -> Pose2 | None:
        """Return where the robot was when it took a scan: its estimate, else the newest pose there is."""
        for (_, number), at in self._poses.items():
            if number == scan.scan_id:
                return at
        newest: m.Pose | None = None
        for message in self._newest.values():
            better = isinstance(message, m.Pose) and message.role != "truth" and not message.lost
            if better and (newest is None or message.time >= newest.time):
                newest = message  # type: ignore[assignment]
        if newest is not None:
            x, y, yaw = newest.pose.tolist()
            return x, y, yaw
        return None

    def _from_truth(self, at: Any) -> Pose2:
        """Return a true pose in the map's frame, which begins at the first one."""
        assert self._truth_origin is not None
        return relative(self._truth_origin, at)
