"""`experiment pillars`: the pillars of turtlebot3_world, mapped from exact poses and found in the map."""

import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import label
from scipy.optimize import least_squares

from knotwork.core.contracts import Map
from knotwork.core.messages import F64, Pose, Scan
from knotwork.plugins.commands.experiment import figures
from knotwork.plugins.commands.experiment.bare_map import available, build_map, build_node, turn
from knotwork.plugins.commands.experiment.map_error import FAR
from knotwork.plugins.commands.experiment.parts import write_json

CENTRES = np.array([(x, y) for y in (-1.1, 0.0, 1.1) for x in (-1.1, 0.0, 1.1)])  # m, of the world file
RADIUS = 0.15  # m
MAPS = ("surface", "bilinear")
RESOLUTION = 0.015  # m
CLAMP = 1000.0  # log-odds: no bound is reached, so a wall keeps a ridge
_CELL = 0.005  # m, at which the map is looked at
_HALF = 3.0  # m, the part of the map that is looked at
_SURE = 0.95  # occupancy of what counts as occupied
_LARGEST = 0.4  # m: a cluster that is wider is no pillar
_ROUNDS = 3  # of looking from the centre found before
_DIRECTIONS, _RADII, _FINE = 120, (0.05, 0.30), 0.0025  # m
_EVIDENCE = 2e-3  # of the bound: where there is less the map knows nothing
_REACH = 100.0  # m: of the scans that ask


class Pillars:
    """A recorded log: --runs and --seed change nothing."""

    runs = 1

    def arguments(self, parser: Any) -> None:
        """Add --log, --resolution and --clamp."""
        folder = os.environ.get("KNOTWORK_DATA", "data")
        path = f"{folder}/turtlebot3_world/turtle_world.txt.xz"
        parser.add_argument("--log", default=path, metavar="FILE", help=f"log with true poses (default {path})")
        parser.add_argument(
            "--clamp", type=float, default=CLAMP, metavar="L", help=f"bound of their log-odds (default {CLAMP:g})"
        )
        parser.add_argument(
            "--resolution", type=float, default=RESOLUTION, metavar="M", help=f"of the maps (default {RESOLUTION})"
        )

    def run(self, arguments: Any) -> int:
        """Map, find the pillars, write results.json and a figure, print a table."""
        out = Path(arguments.out)
        out.mkdir(parents=True, exist_ok=True)
        scans = scans_with_truth(arguments.log)
        charts = {name: mapped(name, scans, arguments.resolution, arguments.clamp) for name in available(MAPS)}
        fits = {name: found_in(chart) for name, chart in charts.items()}
        results = {
            "scans": len(scans),
            "resolution_m": arguments.resolution,
            "clamp": arguments.clamp,
            "maps": {name: errors_of(fit) for name, fit in fits.items()},
        }
        write_json(out / "results.json", results)
        if not arguments.no_figures:
            _picture(out, charts["surface"], fits["surface"])
        sys.stdout.write(json.dumps(results, indent=1) + "\n" if arguments.json else _text(results))
        return 0


def scans_with_truth(path: str) -> list[tuple[Scan, F64]]:
    """Return the scans of a Gazebo log with the true pose (3,) of the robot.

    Raises
    ------
    KnotworkError
        The log cannot be read.
    """
    driver = build_node("gazebo-text", {"path": path})
    driver.open()
    truths: dict[int, F64] = {}
    scans: list[Scan] = []
    try:
        for event in driver.events():
            if isinstance(event, int):
                continue
            message = event[1]
            if isinstance(message, Pose):
                truths[message.scan_id] = message.pose
            elif isinstance(message, Scan):
                scans.append(message)
    finally:
        driver.close()
    return [(scan, truths[scan.scan_id]) for scan in scans]


def mapped(name: str, scans: list[tuple[Scan, F64]], resolution: float, clamp: float) -> Map:
    """Return a map of the scans at their true poses."""
    chart = build_map(name, (resolution,), clamp=clamp)
    for scan, pose in scans:
        chart.update(scan, pose)
    return chart


def found_in(chart: Map) -> F64:
    """Return circles (k, 3), centre and radius [m], of the small clusters of what is surely occupied."""
    axis = np.arange(-_HALF, _HALF, _CELL)
    x, y = np.meshgrid(axis, axis)
    occupied = chart.occupancy(np.column_stack((x.ravel(), y.ravel()))).reshape(x.shape) > _SURE
    numbers, count = label(occupied, np.ones((3, 3)))
    circles = []
    for number in range(1, count + 1):
        points = np.column_stack((x[numbers == number], y[numbers == number]))
        if len(points) > 50 and np.ptp(points, axis=0).max() < 2.0 * _LARGEST:
            circle = np.array((*points.mean(axis=0), np.ptp(points, axis=0).mean() / 2.0))
            for _ in range(_ROUNDS):
                ridge = ridge_around(chart, circle[:2])
                if len(ridge) < 3:
                    break
                circle = fit_circle(ridge, circle)
            circles.append(circle)
    return np.array(circles).reshape(-1, 3)


def ridge_around(chart: Map, centre: F64) -> F64:
    """Return where the map is highest in each direction from `centre` (2,), as far as it knows: points (n, 2)."""
    pose = np.array((*centre, 0.0))
    radii = np.arange(*_RADII, _FINE)
    profile = np.empty((len(radii), _DIRECTIONS))
    for row, radius in zip(profile, radii, strict=True):
        row[:] = chart.alignment(turn(np.full(_DIRECTIONS, radius), _REACH), pose).residuals(pose, 0)[0]
    far = np.array((FAR, FAR, 0.0))
    unknown = chart.alignment(turn(np.full(_DIRECTIONS, RADIUS), _REACH), far).residuals(far, 0)[0][0]
    best = profile.argmin(axis=0)
    known = (profile.min(axis=0) < (1.0 - _EVIDENCE) * unknown) & (best > 0) & (best < len(radii) - 1)
    angles = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    found = radii[best][:, None] * np.column_stack((np.cos(angles), np.sin(angles))) + centre
    ridge: F64 = found[known]
    return ridge


def fit_circle(points: F64, start: F64) -> F64:
    """Return centre and radius (3,) of the circle with the least robust distances to points (n, 2)."""
    fit = least_squares(
        lambda c: np.hypot(points[:, 0] - c[0], points[:, 1] - c[1]) - c[2], start, loss="soft_l1", f_scale=0.01
    )
    return np.asarray(fit.x)


def errors_of(circles: F64) -> dict[str, Any]:
    """Return how far each pillar's centre and radius are from the world file's; None for one that was not found."""
    rows = []
    for centre in CENTRES:
        distances = np.hypot(*(circles[:, :2] - centre).T) if len(circles) else np.array([np.inf])
        best = int(distances.argmin())
        known = distances[best] < RADIUS
        rows.append(
            {
                "pillar": centre.tolist(),
                "centre_error_m": float(distances[best]) if known else None,
                "radius_error_m": float(circles[best, 2] - RADIUS) if known else None,
            }
        )
    centre, radius = ([r[k] for r in rows if r[k] is not None] for k in ("centre_error_m", "radius_error_m"))
    return {
        "found": len(centre),
        "others": len(circles) - len(centre),
        "centre_max_m": max(centre, default=None),
        "radius_max_m": max((abs(value) for value in radius), default=None),
        "radius_mean_m": float(np.mean(radius)) if radius else None,
        "pillars": rows,
    }


def _picture(out: Path, chart: Map, circles: F64) -> None:
    figure, axes = figures.subplots(1, 2, figsize=(13, 6.2))
    for axis, middle, half in ((axes[0], (0.0, 0.0), 2.8), (axes[1], (1.1, 1.1), 0.3)):
        step = half / 400
        x, y = np.meshgrid(
            np.arange(middle[0] - half, middle[0] + half, step), np.arange(middle[1] - half, middle[1] + half, step)
        )
        values = chart.occupancy(np.column_stack((x.ravel(), y.ravel()))).reshape(x.shape)
        extent = (middle[0] - half, middle[0] + half, middle[1] - half, middle[1] + half)
        axis.imshow(values, extent=extent, origin="lower", cmap="gray_r", vmin=-1, vmax=1)
        turn = np.linspace(0.0, 2.0 * np.pi, 100)
        for number, (cx, cy) in enumerate(CENTRES):
            label_ = {"label": "world file"} if number == 0 else {}
            axis.plot(cx + RADIUS * np.cos(turn), cy + RADIUS * np.sin(turn), "tab:red", linewidth=1.0, **label_)
        for number, (cx, cy, radius) in enumerate(circles):
            label_ = {"label": "found in the map"} if number == 0 else {}
            axis.plot(cx + radius * np.cos(turn), cy + radius * np.sin(turn), "--", color="tab:blue", **label_)
        axis.set_xlim(extent[:2])
        axis.set_ylim(extent[2:])
        figures.label(axis, "x [m]", "y [m]")
        axis.grid(False)
    axes[0].legend()
    figures.save(figure, out, "pillars")


def _text(results: dict[str, Any]) -> str:
    lines = [f"{'map':<10}{'found':>7}{'others':>8}{'centre max mm':>15}{'radius max mm':>15}{'radius mean mm':>16}"]
    for name, row in results["maps"].items():
        cells = [row[key] for key in ("centre_max_m", "radius_max_m", "radius_mean_m")]
        texts = [("-" if cell is None else f"{1e3 * cell:.1f}") for cell in cells]
        lines.append(f"{name:<10}{row['found']:>7}{row['others']:>8}{texts[0]:>15}{texts[1]:>15}{texts[2]:>16}")
    return (
        "\n".join(lines)
        + f"\n{results['scans']} scans at true poses, {results['resolution_m']} m, bound {results['clamp']:g}\n"
    )
