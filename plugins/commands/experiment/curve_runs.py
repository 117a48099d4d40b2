"""A simulated robot that maps a gallery: scans, poses and truths of one run, without the runtime around it."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from knotwork.core.bare_context import BareContext
from knotwork.core.beams import Array, beams_of
from knotwork.core.kernel import kernel
from knotwork.core.messages import F64, Odometry, Pose, Scan, Twist
from knotwork.core.registry import Registry

WORLD = "gallery"
RANGE = 12.0  # m
CELL = 0.05  # m, of the grid that is compared with
_CELLS = 800  # to a side of it
_TURN = 0.5  # rad/s
_STAND = 1_000_000_000  # ns: the first scan, which the map begins with, is taken standing


@dataclass(frozen=True, slots=True)
class Result:
    """Poses (n, 3) of the scans in the map's frame, the true ones too, path driven [m], the map, explored cells."""

    poses: F64
    truths: F64
    lost: int
    path: float
    chart: Any
    explored: int
    explored_by_returns: int


def gallery_run(resolution: tuple[float, ...], turn: bool, seed: int, duration: float = 400.0) -> Result:
    """Follow the walls once round, or turn once on the spot, with a curve map of these knot intervals [m]."""
    registry = Registry(third_parties=False)
    lidar = {"accuracy": 0.0, "range_max": RANGE}
    sim = _node(registry, "sim2d", seed, world=WORLD, duration=duration, stop_when_idle=1.0, lidar=lidar)
    prior = _node(registry, "ekf", seed)
    chart = _node(registry, "spline-curve", seed, resolution=resolution, publish=0.0)
    localizer = _node(registry, "gauss-newton", seed)
    drive = _node(registry, "follow-path", seed, world=WORLD, path="tour")
    localizer.context.uses = {"map": chart, "prior": prior}
    nodes = (sim, prior, chart, localizer, drive)
    for node in nodes:
        node.warm()
    poses: list[F64] = []
    truths: list[F64] = []
    lost = newest = seen = 0
    path = turned = heading = 0.0
    place: F64 | None = None
    cells = np.zeros((2, _CELLS, _CELLS), np.bool_)
    for event in sim.events():
        if isinstance(event, int):
            continue
        port, message = event
        newest = max(newest, message.stamp)
        message = message.sealed(newest, seen)
        seen += 1
        for node in nodes:
            node.context.time = newest
        if isinstance(message, Odometry):
            prior.on_odometry(message)
            prior.context.sent.clear()
            x, y, yaw = sim.base.pose
            path += 0.0 if place is None else math.hypot(x - place[0], y - place[1])
            turned += 0.0 if place is None else math.remainder(yaw - heading, 2.0 * math.pi)
            place, heading = np.array([x, y]), yaw
            sim.on_twist(_command(drive, prior, turn, turned, newest))
        elif isinstance(message, Pose) and port == "truth":
            truths.append(message.pose)
        elif isinstance(message, Scan):
            prior.on_scan(message)
            localizer.on_scan(message)
            pose = localizer.context.sent.pop()[1]
            prior.on_correction(pose.sealed(newest, seen))
            poses.append(pose.pose)
            lost += pose.lost
            rays = beams_of(message, 0.05, RANGE).rays
            explore(cells, rays, truths[-1], CELL)
    return Result(
        np.array(poses), np.array(truths), lost, path, chart, int(cells.any(axis=0).sum()), int(cells[1].sum())
    )


def _node(registry: Registry, plugin: str, seed: int, **keys: Any) -> Any:
    manifest = registry.find(plugin)
    assert manifest is not None
    options = manifest.options() if manifest.options else None
    return registry.load(manifest)(BareContext(plugin, manifest.config(**keys), options, seed=seed))


def _command(drive: Any, prior: Any, turn: bool, turned: float, now: int) -> Twist:
    if now < _STAND:
        return Twist(stamp=now, vx=0.0, wz=0.0)
    if turn:
        return Twist(stamp=now, vx=0.0, wz=_TURN if turned < 2.0 * math.pi - 0.1 else 0.0)
    drive.on_pose(Pose(stamp=now, role="prior", pose=prior.prior(now).pose))
    twist = drive.context.sent.pop()[1]
    assert isinstance(twist, Twist)
    return twist


@kernel
def explore(cells: Array, rays: Array, pose: Array, cell: float) -> None:
    """Mark cells (2, n, n) that rays (k, 6) pass: 1 by a beam that came back, else 0; the origin is in the middle."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    n = cells.shape[1]
    for k in range(rays.shape[0]):
        x = pose[0] + c * rays[k, 0] - s * rays[k, 1]
        y = pose[1] + s * rays[k, 0] + c * rays[k, 1]
        ux = c * rays[k, 2] - s * rays[k, 3]
        uy = s * rays[k, 2] + c * rays[k, 3]
        layer = 1 if rays[k, 5] > 0.0 else 0
        for m in range(int(2.0 * rays[k, 4] / cell) + 1):
            j = math.floor((x + 0.5 * m * cell * ux) / cell) + n // 2
            i = math.floor((y + 0.5 * m * cell * uy) / cell) + n // 2
            if 0 <= i < n and 0 <= j < n:
                cells[layer, i, j] = True
