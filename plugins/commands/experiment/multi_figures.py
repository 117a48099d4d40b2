"""Fig. 9.7 (all scenarios), 9.8 (one of them over time) and 9.9 (the same in the image and in space)."""

from pathlib import Path
from typing import Any

import numpy as np

from knotwork.plugins.commands.experiment import figures
from knotwork.plugins.commands.experiment.scenarios import SETTINGS, Scenario, error_seed, scenario
from knotwork.plugins.commands.experiment.servo_runs import STEP, Trace, trace

_SHOWN = ("passive", "active", "active+", "ekf")

Runs = dict[int, dict[str, list[dict[str, Any]]]]


def draw(out: Path, setting: str, disturbance: str, seed: int, runs: Runs, summary: dict[str, dict[str, Any]]) -> None:
    """Write all figures."""
    _success(out, setting, runs, summary)
    n = 6 if 6 in runs else next(iter(runs))
    modes = runs[n]
    telling = (
        i
        for i, (passive, active) in enumerate(zip(modes.get("passive", []), modes.get("active", []), strict=False))
        if active["success"] and not passive["success"]
    )
    index = next(telling, 0)
    scene = scenario(SETTINGS[setting], n, seed, index)
    gain, errors = SETTINGS[setting].gain, error_seed(seed, index)
    shown = {mode: trace(scene, mode, gain, disturbance, errors) for mode in ("ideal", *_SHOWN)}
    _over_time(out, n, index, shown)
    _in_space(out, scene, shown)


def _success(out: Path, setting: str, runs: Runs, summary: dict[str, dict[str, Any]]) -> None:
    figure, axes = figures.subplots(1, 3, figsize=(14, 4.5))
    modes = list(next(iter(runs.values())))
    width = 0.8 / len(modes)
    for k, mode in enumerate(modes):
        colour = figures.COLOURS[mode]
        place = np.arange(len(runs)) + (k - 0.5 * (len(modes) - 1)) * width
        rows = [summary[str(n)][mode] for n in runs]
        success = np.array([row["success"] for row in rows])
        spread = np.array([(row["success"] - row["ci_low"], row["ci_high"] - row["success"]) for row in rows]).T
        bars = {"ecolor": "0.2", "capsize": 2, "error_kw": {"linewidth": 0.8}}
        axes[0].bar(place, success, width, yerr=np.maximum(spread, 0.0), color=colour, label=mode, **bars)
        depth = [row["depth_error_median_m"] or np.nan for row in rows]
        style = figures.STYLES.get(mode, "-")
        if mode != "ideal":
            axes[1].plot(list(runs), depth, "o" + style, color=colour, label=mode)
        extra = [row["extra_time_median_s"] for row in rows]
        axes[2].plot(list(runs), [np.nan if t is None else t for t in extra], "o" + style, color=colour, label=mode)
    axes[0].set_xticks(np.arange(len(runs)), [str(n) for n in runs])
    axes[0].set_ylim(0.0, 1.08)
    axes[0].legend(fontsize="small", loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=len(modes))
    axes[1].set_yscale("log")
    for axis in axes[1:]:
        axis.set_xticks(list(runs))
    figures.label(axes[0], "points", "success, 95 % interval", f"setting {setting}")
    figures.label(axes[1], "points", "median sum of depth errors [m]", "where passive succeeds")
    figures.label(axes[2], "points", "median extra time over known depth [s]")
    figures.save(figure, out, "fig-9.7-success")


def _over_time(out: Path, n: int, index: int, shown: dict[str, Trace]) -> None:
    figure, axes = figures.subplots(1, 3, figsize=(14, 4))
    for mode, run in shown.items():
        time = np.arange(len(run.errors)) * STEP
        colour = figures.COLOURS[mode]
        look = {"color": colour, "linestyle": figures.STYLES.get(mode, "-"), "label": mode}
        axes[0].semilogy(time, run.errors, **look)
        if mode != "ideal":
            axes[1].semilogy(time, np.abs(run.chi_error).max(axis=1).clip(1e-12), **look)
            axes[2].plot(time, run.phases, **look)
    axes[0].axhline(0.01, color="0.6", linewidth=0.8)
    axes[0].legend(fontsize="small")
    axes[2].set_yticks((1, 2, 3))
    figures.label(axes[0], "time [s]", "image error", f"{n} points, scenario {index}")
    figures.label(axes[1], "time [s]", "largest error of inverse depth [1/m]")
    figures.label(axes[2], "time [s]", "phase")
    figures.save(figure, out, "fig-9.8-one-scenario")


def _in_space(out: Path, scene: Scenario, shown: dict[str, Trace]) -> None:
    figure, axes = figures.subplots(1, 2, figsize=(13, 5.5))
    for mode in ("passive", "active"):
        path = shown[mode].path
        q = np.einsum("kji,knj->kni", path[:, 3:].reshape(-1, 3, 3), scene.points - path[:, None, :3])
        axes[0].plot(q[:, :, 0] / q[:, :, 2], q[:, :, 1] / q[:, :, 2], color=figures.COLOURS[mode], linewidth=1)
        axes[0].plot([], [], color=figures.COLOURS[mode], label=mode)
    axes[0].plot(*scene.goal.T, "kx", label="goal")
    axes[0].invert_yaxis()
    axes[0].set_aspect("equal", adjustable="datalim")
    axes[0].legend(fontsize="small")
    figures.label(axes[0], "x", "y (down)", "image")
    axes[1].remove()
    space = figure.add_subplot(1, 2, 2, projection="3d")
    for mode, run in shown.items():
        look = {"color": figures.COLOURS[mode], "linestyle": figures.STYLES.get(mode, "-"), "label": mode}
        space.plot(run.path[:, 0], run.path[:, 2], -run.path[:, 1], **look)
    space.scatter(scene.points[:, 0], scene.points[:, 2], -scene.points[:, 1], color="k", s=12, label="points")
    space.set_xlabel("right [m]")
    space.set_ylabel("forward [m]")
    space.set_zlabel("up [m]")
    space.legend(fontsize="small", loc="upper left")
    figures.save(figure, out, "fig-9.9-image-and-space")
