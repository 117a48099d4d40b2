"""Draw the pictures of `splines.md`:  python docs/splines_pictures.py  (needs matplotlib)."""

from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("agg")
import matplotlib.pyplot as plt

from knotwork.core.path_planning import Obstacle, plan_path
from knotwork.core.splines import Curve, Surface, UniformBasis

OUT = Path(__file__).parent / "pictures"


def basis() -> None:
    figure, axis = plt.subplots(figsize=(7, 2.4))
    cubic = UniformBasis(3)
    n = 8
    tau = np.linspace(*cubic.domain(n), 400)
    for column in cubic.matrix(tau, n).toarray().T:
        axis.plot(tau, np.where(column > 0, column, np.nan))
    axis.plot(tau, np.ones_like(tau), "k:", lw=1)
    axis.set(xlabel="parameter", ylabel="weight", xticks=cubic.knots(n)[3:-3], xlim=cubic.domain(n), ylim=(0, 1.1))
    axis.text(3.1, 1.02, "the four weights at any place sum to one", fontsize=8)
    save(figure, "spline-basis.png")


def curve() -> None:
    figure, axis = plt.subplots(figsize=(7, 3))
    control = np.array([[0, 0], [1, 1.2], [2, -0.3], [3.2, -0.2], [3.8, 1.4], [5, 1], [5.8, 0.1], [6.4, 1.0]])
    s = Curve(control)
    points = s(np.linspace(*s.domain, 300))
    axis.fill(*control[2:6][[0, 1, 3, 2]].T, alpha=0.15, color="C0", lw=0)
    axis.plot(*control.T, "o--", color="0.6", ms=4, lw=1, label="control points")
    axis.plot(*points.T, "C0", lw=2, label="curve")
    axis.plot(*s(np.arange(3.0, 9.0)).T, "C0o", ms=4, label="knots")
    piece = s(np.linspace(5, 6, 50))
    axis.plot(*piece.T, "C3", lw=3, label="one piece, inside the hull of its four")
    query = np.array([[2.6, 1.0]])
    tau, _ = s.nearest(query)
    axis.plot(*np.vstack((query, s(tau))).T, "k-", lw=1)
    axis.plot(*query.T, "kx", label="a point and its nearest")
    axis.set_aspect("equal")
    axis.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1, 1))
    save(figure, "spline-curve.png")


def surface() -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(0, 6, (1500, 2))
    truth = np.sin(points[:, 0]) * np.cos(points[:, 1])
    noisy = truth + rng.normal(0, 0.2, len(points))
    fitted = Surface.fit(points, noisy, 0.5, smoothness=0.05)
    grid = np.linspace(0.1, 5.9, 200)
    x, y = np.meshgrid(grid, grid)
    value, gradient = fitted.with_gradient(np.column_stack((x.ravel(), y.ravel())))
    figure, axes = plt.subplots(1, 2, figsize=(7, 3))
    axes[0].set_aspect("equal")
    axes[0].scatter(*points.T, c=noisy, s=3)
    axes[0].set_title("1500 noisy samples", fontsize=9)
    axes[1].imshow(value.reshape(x.shape), origin="lower", extent=(0.1, 5.9, 0.1, 5.9))
    every = (slice(None, None, 14),) * 2
    u, v = (gradient[:, k].reshape(x.shape) for k in range(2))
    axes[1].quiver(x[every], y[every], u[every], v[every], color="w", width=0.004)
    axes[1].set_title("fit, knots every 0.5 m, with its gradient", fontsize=9)
    save(figure, "spline-surface.png")


def path() -> None:
    walls = [Obstacle(np.array(w)) for w in ([[1, -1], [1, 0.4]], [[2.2, 2], [2.2, -0.2]])]
    disc = Obstacle(np.array([[3.4, 0.1]]), 0.25)
    route = [[0, 0], [1, 1], [2.2, -0.8], [3.4, 0.9], [4.5, 0]]
    s = plan_path(route, [*walls, disc], clearance=0.15, spacing=0.25)
    figure, axis = plt.subplots(figsize=(7, 3.4))
    for wall in walls:
        axis.plot(*wall.points.T, "k", lw=3)
    axis.add_patch(plt.Circle((3.4, 0.1), 0.25, color="k"))
    axis.plot(*np.array(route).T, "--", color="0.6", label="rough route")
    axis.plot(*s.control.T, ".", color="C1", label="control points")
    axis.plot(*s(np.linspace(*s.domain, 500)).T, "C0", lw=2, label="path")
    axis.set_aspect("equal")
    axis.legend(fontsize=7)
    save(figure, "spline-path.png")


def save(figure: plt.Figure, name: str) -> None:
    figure.tight_layout()
    figure.savefig(OUT / name, dpi=75, metadata={"Software": None})
    plt.close(figure)


if __name__ == "__main__":
    OUT.mkdir(exist_ok=True)
    for draw in (basis, curve, surface, path):
        draw()
