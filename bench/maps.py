"""Every map behind the same localiser on one log: accuracy, processor time a scan, bytes, side by side.

    python bench/maps.py LOG [--limit N]

All maps take the same scan before the next is read, each with its own prior and localiser, so that what else the
machine does hits all of them. `x sensor` is the log's time over the processor time to localise and update.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from slam import Rig, messages

from knotwork.core.messages import Scan

LEVELS = [0.30, 0.125, 0.05]  # m
MAPS: dict[str, tuple[str, dict[str, Any]]] = {
    "surface, and 3 cm": ("spline-surface", {"resolution": [*LEVELS, 0.03]}),
    "surface": ("spline-surface", {"resolution": LEVELS}),
    "grid nearest": ("grid", {"resolution": LEVELS, "interpolation": "nearest"}),
    "grid bilinear": ("grid", {"resolution": LEVELS, "interpolation": "bilinear"}),
    "grid bicubic": ("grid", {"resolution": LEVELS, "interpolation": "bicubic"}),
    "tsdf": ("tsdf", {"resolution": LEVELS}),
    "curve": ("spline-curve", {"resolution": [0.4, 0.2, 0.1]}),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", type=Path)
    parser.add_argument("--limit", type=int, default=0, help="scans")
    arguments = parser.parse_args()
    rigs = {name: Rig({"map": keys}, plugin) for name, (plugin, keys) in MAPS.items()}
    first = last = 0
    count = 0
    for message in messages(arguments.log, {}):
        for rig in rigs.values():
            rig.take(message)
        first, last = first or message.time, message.time
        count += isinstance(message, Scan)
        if arguments.limit and count >= arguments.limit:
            break
    relations = arguments.log.with_name(arguments.log.name.replace(".clf", ".relations"))
    print(f"{count} scans of {arguments.log.name}, {(last - first) / 1e9:.0f} s; processor time a scan")
    print(f"{'map':<20}{'localise ms':>12}{'update ms':>11}{'x sensor':>10}{'bytes':>12}{'lost':>6}  error")
    for name, rig in rigs.items():
        update = float(np.sum(rig.context.times.get("update", [0]))) / count / 1e6
        both = float(np.sum(rig.totals)) / count / 1e6
        speed = (last - first) / float(np.sum(rig.totals))
        lost = sum(lost for _, lost in rig.quality)
        said = ""
        if relations.exists():
            score = rig.score(relations)
            said = f"{score['trans_abs_mean_m']:.4f} m, {score['rot_abs_mean_deg']:.3f} deg"
        numbers = f"{both - update:>12.3f}{update:>11.3f}{speed:>10.0f}{rig.chart.nbytes:>12,}{lost:>6}"
        print(f"{name:<20}{numbers}  {said}")


if __name__ == "__main__":
    main()
