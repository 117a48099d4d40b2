"""SLAM on a CARMEN log: accuracy against relations, time a scan, memory.

    python bench/slam.py LOG [--relations FILE] [--limit N] [--every N] [--set map.sigma=0.2] ...

Runs log driver, prior, map and localiser in a loop without the runtime, so that the figures are theirs.
Times are the thread's processor time, stated also as multiples of what the surface kernel of
`knotwork.core.splines` takes for value and gradient at 1040 points, timed between scans of the same run.
"""

import argparse
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from knotwork.core.bare_context import BareContext
from knotwork.core.evaluation.relations import read_relations, score_relations
from knotwork.core.evaluation.tum import StampedPoses
from knotwork.core.messages import Message, Odometry, Pose, Scan
from knotwork.core.registry import Registry
from knotwork.core.splines import Surface


@dataclass
class Bench(BareContext):
    """Times blocks, prints reports."""

    times: dict[str, list[int]] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    def report(self, level: str, text: str) -> None:
        print(f"  {self.name} {level} at {self.time / 1e9:.1f} s: {text}")

    def count(self, name: str, by: int = 1) -> None:
        self.counts[name] = self.counts.get(name, 0) + by

    @contextmanager
    def measure(self, name: str = "") -> Iterator[None]:
        start = time.thread_time_ns()
        yield
        self.times.setdefault(name, []).append(time.thread_time_ns() - start)


def build(registry: Registry, plugin: str, **keys: Any) -> tuple[Any, Bench]:
    """Build a plugin with those keys of its config or of its options."""
    manifest = registry.find(plugin)
    assert manifest is not None, registry.why_not(plugin)
    own = {k: v for k, v in keys.items() if k in manifest.config.model_fields}
    rest = {k: v for k, v in keys.items() if k not in own}
    options = manifest.options(**rest) if manifest.options else None
    context = Bench(plugin, manifest.config(**own), options)
    return registry.load(manifest)(context), context


class Yardstick:
    """The surface kernel at 1040 points as a scan sees them: value and both partials, results allocated."""

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        self.surface = Surface.from_control(rng.standard_normal((203, 203)), 0.05, origin=(0.0, 0.0))
        angle = np.linspace(0, 2 * np.pi, 1040, endpoint=False)
        ranges = 4.0 + np.cumsum(rng.normal(0, 0.02, 1040))
        self.points = 5.0 + ranges[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
        self.points = self.points.clip(0.1, 9.9)
        self.surface.with_gradient(self.points)
        self.times: list[int] = []

    def measure(self) -> None:
        for _ in range(5):
            start = time.thread_time_ns()
            self.surface.with_gradient(self.points)
            self.times.append(time.thread_time_ns() - start)

    def milliseconds(self) -> float:
        return float(np.median(self.times)) / 1e6


class Rig:
    """Prior, map and localiser in a loop of their own; settings are keys by node.

    Attributes
    ----------
    poses, stamps, quality
        Of each scan: pose (3,), stamp [ns], (quality, lost).
    totals
        Processor time of the localiser with the map's update, of each scan [ns].
    """

    def __init__(self, settings: dict[str, dict[str, Any]], plugin: str) -> None:
        registry = Registry(third_parties=False)
        self.prior, first = build(registry, "ekf", **settings.get("prior", {}))
        self.chart, second = build(registry, plugin, **settings.get("map", {}))
        self.localizer, self.context = build(registry, "gauss-newton", **settings.get("localizer", {}))
        self.context.uses = {"map": self.chart, "prior": self.prior}
        self._contexts = [first, second, self.context]
        for node in (self.prior, self.chart, self.localizer):
            node.warm()
            node.open()
        self.poses: list[Any] = []
        self.stamps: list[int] = []
        self.quality: list[tuple[float, bool]] = []
        self.totals: list[int] = []

    def take(self, message: Message) -> None:
        """Take odometry or a scan, sealed with the time of the run."""
        for each in self._contexts:
            each.time = message.time
        if isinstance(message, Odometry):
            self.prior.on_odometry(message)
        elif isinstance(message, Scan):
            self.prior.on_scan(message)
            before = time.thread_time_ns()
            self.localizer.on_scan(message)
            self.totals.append(time.thread_time_ns() - before)
            pose = self.context.sent.pop()[1]
            assert isinstance(pose, Pose)
            self.prior.on_correction(pose.sealed(message.time, message.seq))
            self.poses.append(pose.pose)
            self.stamps.append(message.stamp)
            self.quality.append((pose.quality, pose.lost))

    def score(self, relations: Path) -> dict[str, Any]:
        """Return the errors of the relations."""
        estimate = StampedPoses(np.array(self.stamps), np.array(self.poses))
        return score_relations(estimate, read_relations(relations))


def messages(log: Path, keys: dict[str, Any], every: int = 1) -> Iterator[Message]:
    """Yield odometry and each so manieth scan of a CARMEN log, sealed."""
    driver, _ = build(Registry(third_parties=False), "carmen", path=str(log), **keys)
    newest = 0
    for seen, (_port, message) in enumerate(driver.events()):
        newest = max(newest, message.stamp)
        if not (isinstance(message, Scan) and message.scan_id % every):
            yield message.sealed(newest, seen)


def run(
    log: Path, settings: dict[str, dict[str, Any]], limit: int, every: int, plugin: str = "spline-surface"
) -> dict[str, Any]:
    rig, yardstick = Rig(settings, plugin), Yardstick()
    started = time.perf_counter()
    for message in messages(log, settings.get("log", {}), every):
        rig.take(message)
        if isinstance(message, Scan) and len(rig.poses) % 100 == 0:
            yardstick.measure()
        if limit and len(rig.poses) >= limit:
            break
    wall = time.perf_counter() - started
    ms = lambda values: {  # noqa: E731
        "n": len(values),
        "mean": float(np.mean(values)) / 1e6,
        "p95": float(np.percentile(values, 95)) / 1e6,
        "sum_per_scan": float(np.sum(values)) / len(rig.poses) / 1e6,
    }
    return {
        "poses": np.array(rig.poses),
        "stamps": np.array(rig.stamps),
        "quality": np.array(rig.quality),
        "covariances": None,
        "map": rig.chart,
        "wall": wall,
        "total": ms(rig.totals),
        "yardstick": yardstick.milliseconds() if yardstick.times else float("nan"),
        "times": {k: ms(v) for k, v in rig.context.times.items()},
        "statistics": rig.localizer.statistics(),
        "prior_counts": rig.prior.context.counts,
        "nbytes": rig.chart.nbytes,
    }


def show(result: dict[str, Any], relations: Path | None) -> None:
    quality = result["quality"]
    print(
        f"{len(result['poses'])} scans in {result['wall']:.1f} s, map {result['nbytes'] / 1e6:.1f} MB, "
        f"quality p1 {np.nanpercentile(quality[:, 0], 1):.2f} p5 {np.nanpercentile(quality[:, 0], 5):.2f} "
        f"p50 {np.nanpercentile(quality[:, 0], 50):.2f}, no information {int(np.isnan(quality[:, 0]).sum())}, "
        f"{result['statistics']}, prior {result['prior_counts']}"
    )
    unit = result["yardstick"]
    print(f"  surface kernel at 1040 points, value and gradient: {unit:.4f} ms, 1 x")
    for name, t in {"localizer": result["total"], **result["times"]}.items():
        print(
            f"  {name:10s} n {t['n']:6d} mean {t['mean']:.3f} ms ({t['mean'] / unit:.1f} x) "
            f"p95 {t['p95']:.3f} ms ({t['p95'] / unit:.1f} x), {t['sum_per_scan']:.3f} ms a scan"
        )
    if relations is not None:
        score = score_relations(StampedPoses(result["stamps"], result["poses"]), read_relations(relations))
        for name, part in (("all", score), ("short", score["short"]), ("long", score["long"])):
            if part["used"]:
                print(
                    f"  {name:6s}{part['trans_abs_mean_m']:.4f} +- {part['trans_abs_std_m']:.4f} m, "
                    f"{part['rot_abs_mean_deg']:.3f} +- {part['rot_abs_std_deg']:.3f} deg, "
                    f"{part['used']} used, {part['missed']} missed"
                )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", type=Path)
    parser.add_argument("--map", default="spline-surface", help="plugin")
    parser.add_argument("--relations", type=Path)
    parser.add_argument("--limit", type=int, default=0, help="scans")
    parser.add_argument("--every", type=int, default=1, help="only each so manieth scan")
    parser.add_argument("--set", action="append", default=[], help="node.key=value, value in JSON")
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    settings: dict[str, dict[str, Any]] = {}
    for item in arguments.set:
        key, _, value = item.partition("=")
        node, _, name = key.partition(".")
        settings.setdefault(node, {})[name] = json.loads(value)
    result = run(arguments.log, settings, arguments.limit, arguments.every, arguments.map)
    relations = arguments.relations
    beside = arguments.log.with_name(arguments.log.name.replace(".clf", ".relations"))
    if relations is None and beside != arguments.log and beside.exists():
        relations = beside
    show(result, relations)
    if arguments.picture:
        from PIL import Image

        cells, resolution, origin = result["map"].rasterize()
        grey = np.where(cells < 0, 205, 255 - 2.55 * cells).astype(np.uint8)
        columns = ((result["poses"][:, 0] - origin[0]) / resolution).astype(int).clip(0, cells.shape[1] - 1)
        rows = ((result["poses"][:, 1] - origin[1]) / resolution).astype(int).clip(0, cells.shape[0] - 1)
        colour = np.repeat(grey[:, :, None], 3, axis=2)
        colour[rows, columns] = (220, 30, 30)
        Image.fromarray(colour[::-1]).save(arguments.picture)


if __name__ == "__main__":
    main()
