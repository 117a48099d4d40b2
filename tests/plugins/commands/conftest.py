import math

import numpy as np
import pytest


@pytest.fixture(scope="session")
def tour(tmp_path_factory):
    """A short CARMEN log in a rectangular room, its exact relations and the same as a trajectory."""
    folder = tmp_path_factory.mktemp("tour")
    angles = np.radians(np.arange(180) - 90.0)
    lines, poses = [], []
    for i in range(25):
        x, y, yaw = -1.0 + 0.04 * i, 0.2 * math.sin(0.1 * i), 0.02 * i
        u = np.stack((np.cos(angles + yaw), np.sin(angles + yaw)))
        with np.errstate(divide="ignore"):
            ahead, behind = ((np.array(corner) - [[x], [y]]) / u for corner in ([[4.0], [3.0]], [[-3.0], [-2.5]]))
            to_walls = np.where(u > 0, ahead, behind)
        ranges = " ".join(f"{r:.3f}" for r in to_walls.min(axis=0))
        # The odometry's scale is 5 % off.
        at = f"{1.05 * x:.6f} {1.05 * y:.6f} {yaw:.6f}"
        lines.append(f"FLASER 180 {ranges} {at} {at} {100 + 0.2 * i:.6f} host {0.2 * i:.6f}\n")
        poses.append((100 + 0.2 * i, x, y, yaw))
    (folder / "tour.clf").write_text("".join(lines))
    relations = []
    for (t1, x1, y1, a1), (t2, x2, y2, a2) in zip(poses, poses[8:], strict=False):
        c, s, dx, dy = math.cos(a1), math.sin(a1), x2 - x1, y2 - y1
        relations.append(f"{t1:.6f} {t2:.6f} {c * dx + s * dy:.6f} {c * dy - s * dx:.6f} 0 0 0 {a2 - a1:.6f}\n")
    (folder / "tour.relations").write_text("".join(relations))
    (folder / "tour.txt").write_text("".join(f"{t:.6f} {x:.6f} {y:.6f} {a:.6f}\n" for t, x, y, a in poses))
    return folder
