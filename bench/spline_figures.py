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
    """Write `points.png` (time against points) and `growth.png` (time against map area)."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.size": 9})
    style = {
        name: {"color": f"C{k}", "marker": ".", "label": name, "lw": 1 if k else 2.2} for k, name in enumerate(SHOWN)
    }
    tasks = result["tables"]
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), sharey=True)
    for axis, task, title in ((axes[0], "curve_d", "curve + derivative"), (axes[1], "surface_d", "surface + partials")):
        for name in SHOWN:
            if name in tasks[task]:
                pairs = [(n, t) for n, t in zip(result["sizes"], tasks[task][name], strict=True) if t]
                axis.loglog(*zip(*pairs, strict=True), **style[name])
        axis.set(title=title, xlabel="points")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("time of a call [µs]")
    axes[1].legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5))
    figure.tight_layout()
    figure.savefig(out / "points.png", dpi=80)
    figure, axis = plt.subplots(figsize=(6.5, 3.8))
    for name in SHOWN:
        times = result["growth"].get(name, [])[:3]
        pairs = [(area, t) for area, t in zip((1, 100, 10_000), times, strict=False) if t]
        if pairs:
            axis.loglog(*zip(*pairs, strict=True), **style[name])
    axis.set(title="surface + partials at 1040 points", xlabel="map [m²]", ylabel="time of a call [µs]")
    axis.grid(alpha=0.3)
    axis.legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5))
    figure.tight_layout()
    figure.savefig(out / "growth.png", dpi=80)
    plt.close("all")
