"""The thesis's Figs 4.6 and 4.7, from the results of `splines.py`."""

from pathlib import Path

SHOWN = (
    "knotwork, float32",
    "the thesis's way in NumPy",
    "Splipy",
    "SciPy BSpline / NdBSpline",
    "SciPy RectBivariateSpline.ev",
    "interpolation.py",
    "NURBS-Python (geomdl)",
    "bspline",
)


def draw(result: dict, out: Path) -> None:
    """Write `points.svg` (time against points) and `growth.svg` (time against map area)."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"svg.fonttype": "none", "font.size": 9, "svg.hashsalt": "knotwork"})
    tasks = result["tables"]
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), sharey=True)
    for axis, task, title in ((axes[0], "curve_d", "curve + derivative"), (axes[1], "surface_d", "surface + partials")):
        for name in SHOWN:
            if name in tasks[task]:
                pairs = [(n, t) for n, t in zip(result["sizes"], tasks[task][name], strict=True) if t]
                axis.loglog(*zip(*pairs, strict=True), marker=".", label=name, lw=2.2 if "knotwork" in name else 1)
        axis.set(title=title, xlabel="points")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("time of a call [µs]")
    axes[1].legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5))
    figure.tight_layout()
    figure.savefig(out / "points.svg", metadata={"Date": None})
    figure, axis = plt.subplots(figsize=(6.5, 3.8))
    for name in SHOWN:
        times = result["growth"].get(name, [])[:3]
        pairs = [(area, t) for area, t in zip((1, 100, 10_000), times, strict=False) if t]
        if pairs:
            axis.loglog(*zip(*pairs, strict=True), marker=".", label=name, lw=2.2 if "knotwork" in name else 1)
    axis.set(title="surface + partials at 1040 points", xlabel="map [m²]", ylabel="time of a call [µs]")
    axis.grid(alpha=0.3)
    axis.legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5))
    figure.tight_layout()
    figure.savefig(out / "growth.svg", metadata={"Date": None})
    plt.close("all")
