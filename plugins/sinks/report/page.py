"""The report as HTML: no file beside it, no script, readable on paper."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np

from knotwork.core.messages import UNSET, Grid
from knotwork.plugins.sinks.report import ReportConfig, charts
from knotwork.plugins.sinks.report.errors import Poses, Rows, against_files, against_truth, in_map


@dataclass(slots=True)
class Story:
    """What a run did, as far as the report tells it."""

    run: dict[str, Any]
    estimates: dict[str, Poses] = field(default_factory=dict)
    truths: dict[str, Poses] = field(default_factory=dict)
    grids: dict[str, Grid] = field(default_factory=dict)
    events: list[tuple[str, str, str]] = field(default_factory=list)
    events_in_all: int = 0
    statistics: dict[str, Any] = field(default_factory=dict)
    complete: bool = False
    scans: int = 0
    lost: int = 0
    first: int = UNSET
    last: int = UNSET


def page(story: Story, config: ReportConfig) -> tuple[str, list[str]]:
    """Return the page, and what was wrong with the files to compare with."""
    title = str(story.run.get("pipeline", "run"))
    truth = in_map(next(iter(story.truths.values()), Poses()))
    first = next(iter(story.estimates.values()), Poses())
    tables, wrong = against_files(config, first)
    parts = [
        f"<h1>{escape(title)}</h1>",
        "" if story.complete else '<p class="warning">The run did not end well: its last statistics are missing.</p>',
        _figures(story, first),
        "<h2>Map and trajectory</h2>",
        _map(story, truth),
        _errors(story, truth, tables, wrong),
        _latencies(story.statistics),
        _events(story),
        _run(story.run),
    ]
    body = "\n".join(part for part in parts if part)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)} - Knotwork report</title>\n<style>{_STYLE}</style></head>\n"
        f"<body>\n{body}\n</body></html>\n"
    ), wrong


def _figures(story: Story, estimate: Poses) -> str:
    data = story.statistics
    duration = (story.last - story.first) * 1e-9
    wall = data.get("wall_s")
    steps = np.diff(estimate.array()[:, :2], axis=0)
    drops = sum(row.get("drops", 0) for row in data.get("nodes", {}).values())
    shown = {
        "scans": f"{story.scans}",
        "log": f"{duration:.1f} s",
        "wall time": f"{wall:.1f} s" if wall else "",
        "real-time factor": f"{duration / wall:.1f}" if wall else "",
        "path": f"{np.hypot(steps[:, 0], steps[:, 1]).sum():.1f} m" if len(steps) else "",
        "lost scans": f"{story.lost}",
        "map": f"{sum(grid.map_bytes for grid in story.grids.values()) / 1e6:.2f} MB" if story.grids else "",
        "peak memory": f"{data['peak_rss_mb']:.0f} MB" if data.get("peak_rss_mb") else "",
        "drops": f"{drops}" if data else "",
    }
    cells = "".join(f"<div><b>{value}</b><span>{name}</span></div>" for name, value in shown.items() if value)
    return f'<div class="figures">{cells}</div>'


def _map(story: Story, truth: Poses) -> str:
    paths = [(truth.array(), charts.TRUTH)] if truth.poses else []
    legend = [("truth", charts.TRUTH)] if truth.poses else []
    for number, (stream, poses) in enumerate(story.estimates.items()):
        colour = charts.COLOURS[number % len(charts.COLOURS)]
        paths.append((poses.array(), colour))
        legend.append((stream, colour))
    keys = " ".join(f'<span class="key" style="background:{colour}"></span>{escape(name)}' for name, colour in legend)
    more = [charts.plane([grid], paths) for grid in list(story.grids.values())[1:]]
    return charts.plane(list(story.grids.values()), paths) + f"<p>{keys}</p>" + "".join(more)


def _errors(story: Story, truth: Poses, tables: Iterable[tuple[str, Rows]], wrong: list[str]) -> str:
    out = []
    if truth.poses:
        rows: Rows = [("against the truth", "scans", "position rms [m]", "max [m]", "heading rms [deg]", "max [deg]")]
        for number, (stream, poses) in enumerate(story.estimates.items()):
            found = against_truth(poses, truth)
            if not len(found):
                continue
            times, position, heading = found.T
            colour = charts.COLOURS[number % len(charts.COLOURS)]
            out.append(charts.line(times, [(position, colour)], "m", f"position error, {escape(stream)}"))
            out.append(charts.line(times, [(heading, colour)], "deg", f"heading error, {escape(stream)}"))
            figures = (_rms(position), position.max(), _rms(heading), np.abs(heading).max())
            rows.append((stream, str(len(found)), *(f"{value:.4f}" for value in figures)))
        out.append(_table(rows))
    out += [f"<h3>{escape(title)}</h3>{_table(rows)}" for title, rows in tables]
    out += [f'<p class="warning">{escape(line)}</p>' for line in wrong]
    return "<h2>Errors</h2>" + "".join(out) if out else ""


def _latencies(data: dict[str, Any]) -> str:
    nodes = {name: row for name, row in data.get("nodes", {}).items() if row.get("n") or row.get("drops")}
    if not nodes:
        return ""
    histograms: dict[str, Any] = data.get("histograms", {})
    ends = [float(upper) for buckets in histograms.values() for upper, _ in buckets if upper > 0]
    low, high = (min(ends) / 2, max(ends) * 1.2) if ends else (0.001, 1.0)
    head = ("node", "n", "mean", "p50", "p95", "p99", "max [ms]", "drops")
    lines = ["<tr>" + "".join(f"<th>{text}</th>" for text in head) + f"<th>{charts.axis(low, high)}</th></tr>"]
    for name, row in nodes.items():
        times = (row.get(f"{key}_ms") for key in ("mean", "p50", "p95", "p99", "max"))
        cells = [escape(name), row.get("n", 0), *("" if t is None else f"{t:.3f}" for t in times), row.get("drops", "")]
        bars = charts.histogram(histograms[name], low, high) if name in histograms else ""
        lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + f"<td>{bars}</td></tr>")
    return f'<h2>Latencies and drops</h2><div class="wide"><table>{"".join(lines)}</table></div>' + _counters(data)


def _counters(data: dict[str, Any]) -> str:
    rows: Rows = [("node", "counter", "value")]
    for node, counters in data.get("counters", {}).items():
        rows += [(node, name, f"{value:g}") for name, value in counters.items() if math.isfinite(value) and value]
    return f"<details><summary>Counters</summary>{_table(rows)}</details>" if len(rows) > 1 else ""


def _events(story: Story) -> str:
    if not story.events_in_all:
        return "<h2>Warnings and errors</h2><p>None.</p>"
    lines = "".join(
        f'<li class="{level}">{level}: {escape(node)}: {escape(text)}</li>' for level, node, text in story.events
    )
    more = story.events_in_all - len(story.events)
    rest = f"<p>and {more} more</p>" if more else ""
    return f"<h2>Warnings and errors ({story.events_in_all})</h2><ul>{lines}</ul>{rest}"


def _run(run: dict[str, Any]) -> str:
    versions: Rows = [("version of", ""), *((str(k), str(v)) for k, v in run.get("versions", {}).items())]
    plugins: Rows = [("node", "plugin"), *((str(k), str(v)) for k, v in run.get("plugins", {}).items())]
    return (
        f"<h2>Configuration</h2><p>seed {escape(str(run.get('seed', '')))}</p>"
        f"<pre>{escape(str(run.get('config', '')))}</pre>"
        f'<h2>Versions</h2><div class="pair">{_table(versions)}{_table(plugins)}</div>'
    )


def _table(rows: Rows) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in rows[0])
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows[1:])
    return f'<div class="wide"><table><tr>{head}</tr>{body}</table></div>'


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


_STYLE = """
body{font:15px/1.45 system-ui,sans-serif;color:#1f2430;max-width:1040px;margin:0 auto;padding:12px 20px 40px}
h1{margin:.3em 0}h2{margin:1.6em 0 .5em;border-bottom:1px solid #d9dce3;padding-bottom:3px}
.figures{display:flex;flex-wrap:wrap;gap:8px}.figures div{border:1px solid #d9dce3;border-radius:8px;padding:6px 12px}
.figures b{display:block;font-size:18px;font-variant-numeric:tabular-nums}.figures span{color:#6a7180;font-size:12px}
svg{display:block;max-width:100%;height:auto}svg.plane,svg.line{width:100%}
svg text{font:12px system-ui,sans-serif;fill:#444}
svg .name{font-weight:600}svg.bars{width:220px}svg.bars rect{fill:#1f5ab4}svg.bars text{font-size:10px}
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:13px;font-variant-numeric:tabular-nums;margin:6px 0}
th,td{text-align:right;padding:2px 10px;border-bottom:1px solid #eceef2;white-space:nowrap}
th:first-child,td:first-child{text-align:left}th{color:#6a7180;font-weight:500}
.pair{display:flex;flex-wrap:wrap;gap:30px}.pair td{text-align:left}
.key{display:inline-block;width:14px;height:4px;margin:0 5px 3px 12px}
pre{background:#f3f4f7;padding:10px;border-radius:8px;overflow-x:auto;font-size:12.5px}
.warning{color:#8a6100}.error{color:#c62828}ul{font-size:13px;padding-left:18px}
@media print{details>*{display:block}}
"""
