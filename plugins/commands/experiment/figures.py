"""How figures are made and written; the only place that imports matplotlib."""

from pathlib import Path
from typing import Any

from knotwork.core.errors import InputError

STYLES = {"active+": "--", "ekf": "-."}  # where curves lie on each other
COLOURS = {
    "ideal": "0.45",
    "passive": "tab:red",
    "active": "tab:blue",
    "active+": "tab:green",
    "ekf": "tab:purple",
    "ekf active+": "tab:brown",
}


def subplots(rows: int = 1, columns: int = 1, **options: Any) -> tuple[Any, Any]:
    """Return a figure and its axes.

    Raises
    ------
    InputError
        matplotlib is not installed.
    """
    try:
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot
    except ImportError as error:
        raise InputError("figures need matplotlib", hint="pip install knotwork[report], or say --no-figures") from error
    figure, axes = pyplot.subplots(rows, columns, layout="constrained", **options)
    return figure, axes


def label(axis: Any, x: str, y: str, title: str = "") -> None:
    """Name the axes and draw a light grid."""
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    axis.set_title(title, fontsize="medium")
    axis.set_axisbelow(True)
    axis.grid(True, color="0.9")


def save(figure: Any, out: Path, name: str) -> None:
    """Write `name`.png and `name`.svg."""
    from matplotlib import pyplot

    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / f"{name}.png", dpi=130)
    figure.savefig(out / f"{name}.svg")
    pyplot.close(figure)
