"""What a run is measured by: the columns of the table."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from knotwork.core.config.check import check
from knotwork.core.config.tree import Item, Problems, short
from knotwork.plugins.commands.ablate.model import CustomMetric

Figure = tuple[float, float | None] | None  # mean and, where there is one, standard deviation


@dataclass(frozen=True, slots=True)
class Metric:
    """One column; `of(result, scores)` gives its figure, None where the run has none."""

    name: str
    title: str
    unit: str
    digits: int  # behind the point; negative: six significant ones
    of: Callable[[dict[str, Any], dict[str, Any]], Figure]
    better: int = -1  # -1: less is better, 1: more, 0: neither

    @property
    def head(self) -> str:
        """Return title and unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


def _score(part: str, key: str, unit: str) -> Callable[[dict[str, Any], dict[str, Any]], Figure]:
    def of(result: dict[str, Any], scores: dict[str, Any]) -> Figure:
        figures = scores.get("relations")
        figures = figures[part] if figures and part else figures
        mean = figures.get(f"{key}_mean_{unit}") if figures else None
        return None if figures is None or mean is None else (mean, figures[f"{key}_std_{unit}"])

    return of


def _scored(group: str, key: str) -> Callable[[dict[str, Any], dict[str, Any]], Figure]:
    def of(result: dict[str, Any], scores: dict[str, Any]) -> Figure:
        value = (scores.get(group) or {}).get(key)
        return None if value is None else (value, None)

    return of


def _figure(key: str) -> Callable[[dict[str, Any], dict[str, Any]], Figure]:
    def of(result: dict[str, Any], scores: dict[str, Any]) -> Figure:
        value = look_up(result, key)
        return (float(value), None) if isinstance(value, int | float) and not isinstance(value, bool) else None

    return of


METRICS = (
    Metric("trans_m", "translation", "m", 4, _score("", "trans_abs", "m")),
    Metric("trans_short_m", "translation, < 10 s", "m", 4, _score("short", "trans_abs", "m")),
    Metric("trans_long_m", "translation, > 60 s", "m", 4, _score("long", "trans_abs", "m")),
    Metric("trans_sq_m2", "squared translation", "m²", 5, _score("", "trans_sq", "m2")),
    Metric("rot_deg", "rotation", "deg", 3, _score("", "rot_abs", "deg")),
    Metric("rot_short_deg", "rotation, < 10 s", "deg", 3, _score("short", "rot_abs", "deg")),
    Metric("rot_long_deg", "rotation, > 60 s", "deg", 3, _score("long", "rot_abs", "deg")),
    Metric("rot_sq_deg2", "squared rotation", "deg²", 3, _score("", "rot_sq", "deg2")),
    Metric("truth_m", "position to truth, rms", "m", 4, _scored("truth", "position_rms_m")),
    Metric("truth_max_m", "position to truth, max", "m", 4, _scored("truth", "position_max_m")),
    Metric("truth_deg", "heading to truth, rms", "deg", 3, _scored("truth", "heading_rms_deg")),
    Metric("reference_m", "position to reference, rms", "m", 4, _scored("reference", "position_rms_m")),
    Metric("reference_deg", "heading to reference, rms", "deg", 3, _scored("reference", "heading_rms_deg")),
    Metric("localise_ms", "localise", "ms/scan", 3, _figure("localise_ms")),
    Metric("update_ms", "update", "ms/scan", 3, _figure("update_ms")),
    Metric("scan_ms", "localise + update", "ms/scan", 3, _figure("scan_ms")),
    Metric("speed", "speed", "x sensor", 1, _figure("speed"), better=1),
    Metric("map_bytes", "map", "bytes", 0, _figure("map_bytes")),
    Metric("peak_rss_mb", "peak memory", "MB", 0, _figure("statistics.peak_rss_mb")),
    Metric("lost_scans", "lost", "scans", 0, _figure("lost_scans")),
    Metric("scans", "scans", "", 0, _figure("scans"), better=0),
    Metric("path_m", "path", "m", 2, _figure("path_m"), better=0),
    Metric("wall_s", "run time", "s", 1, _figure("statistics.wall_s")),
)
_BY_NAME = {metric.name: metric for metric in METRICS}


def metric_of(name: Any, item: Item, path: str, problems: Problems) -> Metric | None:
    """Return the metric of an entry of `metrics`; None after adding what is wrong to `problems`."""
    if isinstance(name, str) and name in _BY_NAME:
        return _BY_NAME[name]
    if isinstance(name, dict):
        keys = check(CustomMetric, item, tuple(path.split(".")), problems, label="a metric")
        return Metric(keys.name, keys.name, keys.unit, -1, _figure(keys.key), better=0) if keys else None
    problems.add(item.where, path, f"there is no metric {short(name)}", problems.nearest(name, _BY_NAME))
    return None


def look_up(data: Any, key: str) -> Any:
    """Return the value at a dotted path; names may hold dots themselves ("localizer.update"). None without one."""
    if not key:
        return data
    if not isinstance(data, dict):
        return None
    parts = key.split(".")
    for end in range(len(parts), 0, -1):
        name = ".".join(parts[:end])
        if name in data and (value := look_up(data[name], ".".join(parts[end:]))) is not None:
            return value
    return None
