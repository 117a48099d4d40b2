"""The report: one HTML file that needs nothing else, a section for each value of the first axis."""

from html import escape
from typing import Any

import numpy as np

from knotwork.plugins.commands.ablate import charts
from knotwork.plugins.commands.ablate.charts import Box, Series
from knotwork.plugins.commands.ablate.metrics import Metric
from knotwork.plugins.commands.ablate.plan import Plan
from knotwork.plugins.commands.ablate.table import Entry, Row, text_of

_FAR = 3.0  # a map so many times as large as the median one of its section is shown at its own scale
_STYLE = """
:root{color-scheme:light}
body{font:15px/1.45 system-ui,sans-serif;color:#222;background:#fff;margin:0 auto;max-width:1500px;padding:1.2rem}
h1{margin:.2rem 0}h2{margin:2.2rem 0 .4rem;border-bottom:2px solid #eee}h3{margin:1.2rem 0 .3rem;font-size:1rem}
p.facts{color:#666;margin:.2rem 0}
.scroll{overflow-x:auto}
table{border-collapse:collapse;font-variant-numeric:tabular-nums;margin:.6rem 0}
th,td{padding:.25rem .7rem;border-bottom:1px solid #e5e5e5;text-align:right;white-space:nowrap}
th{background:#f6f6f6;white-space:normal;vertical-align:bottom}th.n,td.n{text-align:left}
td.best{font-weight:700}td.failed{color:#b00020}
.maps{display:grid;grid-template-columns:repeat(auto-fill,minmax(330px,1fr));gap:1rem}
.charts{display:grid;grid-template-columns:repeat(auto-fit,minmax(400px,1fr));gap:1rem}
figure{margin:0 0 1rem}.charts svg.plan{background:#fff;height:330px}figcaption{font-size:.9rem;margin-bottom:.2rem}
svg.plan{width:100%;height:360px;background:#d7d7d7;border:1px solid #ccc}
svg.chart{width:100%;max-width:640px}
svg.chart text{font-size:12px;fill:#333}svg.chart .g{stroke:#e6e6e6}svg.chart .m{text-anchor:middle}
svg.chart .e{text-anchor:end}svg.chart .l{fill:none;stroke-width:2}
.map{image-rendering:pixelated}
.key{display:inline-block;width:.8em;height:.8em;border-radius:2px;margin-right:.4em}
.legend span.one{margin-right:1.1em;white-space:nowrap}
pre{white-space:pre-wrap;background:#fff4f4;border-left:3px solid #b00020;padding:.4rem .7rem;margin:.3rem 0}
"""


def report(plan: Plan, rows: list[Row], facts: dict[str, Any]) -> str:
    """Return the report.

    Parameters
    ----------
    rows
        Of the table, in its order.
    facts
        `versions`, `ran` (where) and `notes` (what failed).
    """
    body = [f"<h1>{escape(plan.name)}</h1>", f"<p>{escape(plan.description)}</p>"]
    what = f"{len(plan.runs)} runs of {plan.base}, {', '.join(facts['versions'])}, {facts['ran']}"
    body.append(f'<p class="facts">{escape(what)}</p>')
    body += [f"<pre>{escape(note)}</pre>" for note in facts["notes"]]
    body.append(_table(plan, rows, rows))
    first = next(iter(plan.axes))
    grouped = len(plan.axes) > 1 and first not in plan.average
    for group in _groups(rows, first) if grouped else [("all runs", rows)]:
        body.append(_section(plan, *group, first if grouped else ""))
    head = f'<meta charset="utf-8"><title>{escape(plan.name)}</title><style>{_STYLE}</style>'
    viewport = '<meta name="viewport" content="width=device-width, initial-scale=1">'
    return f"<!doctype html><html lang=en><head>{head}{viewport}</head><body>{''.join(body)}</body></html>\n"


def _groups(rows: list[Row], axis: str) -> list[tuple[str, list[Row]]]:
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.names[axis], []).append(row)
    return list(groups.items())


def _table(plan: Plan, rows: list[Row], compared: list[Row]) -> str:
    """Return a table; the best figure of each section (rows of one first value) is bold."""
    axes = [axis for axis in plan.axes if axis not in plan.average]
    head = "".join(f'<th class="n">{escape(axis)}</th>' for axis in axes)
    head += "".join(f"<th>{escape(metric.head)}</th>" for metric in plan.metrics)
    groups = _groups(compared, axes[0]) if len(axes) > 1 else [("", compared)]
    best = {(name, metric.name): _best(metric, group) for name, group in groups for metric in plan.metrics}
    lines = []
    for row in rows:
        section = row.names[axes[0]] if len(axes) > 1 else ""
        cells = [f'<td class="n">{escape(name)}</td>' for name in row.names.values()]
        if row.state != "done" and not any(row.figures.values()):
            cells.append(f'<td class="n failed" colspan="{len(plan.metrics)}">{escape(row.state)}</td>')
        else:
            for metric in plan.metrics:
                figure = row.figures[metric.name]
                strong = figure is not None and figure[0] == best[section, metric.name]
                cells.append(f"<td{' class=best' if strong else ''}>{escape(text_of(metric, figure))}</td>")
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return f'<div class="scroll"><table><tr>{head}</tr>{"".join(lines)}</table></div>'


def _best(metric: Metric, rows: list[Row]) -> float | None:
    """Return the best figure of some rows; None if there is nothing to choose."""
    means = {figure[0] for row in rows if (figure := row.figures[metric.name]) is not None}
    if len(means) < 2 or metric.better == 0:
        return None
    return max(means) if metric.better > 0 else min(means)


def _section(plan: Plan, title: str, rows: list[Row], axis: str) -> str:
    """Return maps, paths, errors, time and memory of the rows of one group; of averaged runs the first."""
    colours = {id(row): charts.COLOURS[index % len(charts.COLOURS)] for index, row in enumerate(rows)}
    names = {id(row): ", ".join(name for key, name in row.names.items() if key != axis) or title for row in rows}
    shown = [(row, entry) for row in rows if (entry := _first_done(row)) is not None]
    parts = [f"<h2>{escape(f'{axis}: {title}' if axis else title)}</h2>"]
    if not shown:
        return parts[0] + "<p>No run was finished.</p>"
    spot = '<span class="one"><span class="key" style="background:{}"></span>{}</span>'
    keys = "".join(spot.format(colours[id(row)], escape(names[id(row)])) for row in rows)
    parts.append(f'<p class="legend">{keys}</p>')
    paths = {
        id(row): Series(names[id(row)], colours[id(row)], poses.poses)
        for row, entry in shown
        if (poses := entry.stored.poses()) is not None
    }
    parts.append(_maps(plan, shown, names, paths))
    figures = [("paths on top of each other", charts.paths(list(paths.values())))]
    errors = [Series(names[id(row)], colours[id(row)], entry.scores.errors) for row, entry in shown]
    of = next((entry.scores.errors_of for _, entry in shown if entry.scores.errors_of), "")
    figures.append((f"errors against {of}: share that is smaller", charts.cumulative(errors, "translation error [m]")))
    drawn = "".join(f"<div>{_figure(*one)}</div>" for one in figures)
    costs = [("time a scan: localise, update (pale)", _times(shown, names, colours))]
    for key, unit, what in (("map_bytes", "MB", "memory of the map"), ("statistics.peak_rss_mb", "MB", "peak memory")):
        costs.append((what, _memory(shown, names, colours, key, unit)))
    parts.append(f'<div class="charts">{drawn}<div>{"".join(_figure(*one) for one in costs)}</div></div>')
    return "".join(parts)


def _figure(name: str, chart: str) -> str:
    return f"<figure><figcaption>{escape(name)}</figcaption>{chart}</figure>" if chart else ""


def _first_done(row: Row) -> Entry | None:
    return next((entry for entry in row.entries if entry.state == "done"), None)


def _maps(plan: Plan, shown: list[tuple[Row, Entry]], names: dict[int, str], paths: dict[int, Series]) -> str:
    grids = {id(row): grid for row, entry in shown if (grid := entry.stored.grid()) is not None and grid[0].size}
    if not grids:
        return ""
    boxes = {key: charts.grid_box(grid) for key, grid in grids.items()}
    sizes = {key: max(box[2] - box[0], box[3] - box[1]) for key, box in boxes.items()}
    limit = _FAR * float(np.median(list(sizes.values())))
    together = charts.common_box([boxes[key] for key, size in sizes.items() if size <= limit])
    parts = []
    for row, _ in shown:
        key = id(row)
        if key not in grids:
            continue
        figures = ((metric, text_of(metric, row.figures[metric.name])) for metric in plan.metrics[:2])
        said = " · ".join(f"{metric.title} {text} {metric.unit}" for metric, text in figures if text != "-")
        box: Box = together if sizes[key] <= limit else boxes[key]
        scale = "" if sizes[key] <= limit else " (its own scale)"
        picture = charts.chart_of_map(grids[key], paths.get(key), box)
        caption = f"<b>{escape(names[key])}</b>{scale} {escape(said)}"
        parts.append(f"<figure><figcaption>{caption}</figcaption>{picture}</figure>")
    return f'<div class="maps">{"".join(parts)}</div>'


def _times(shown: list[tuple[Row, Entry]], names: dict[int, str], colours: dict[int, str]) -> str:
    rows = []
    for row, entry in shown:
        times = [entry.stored.result.get(key) for key in ("localise_ms", "update_ms")]
        if None not in times:
            rows.append((names[id(row)], colours[id(row)], [float(time) for time in times if time is not None]))
    return charts.bars(rows, "ms", ("localise", "update"))


def _memory(shown: list[tuple[Row, Entry]], names: dict[int, str], colours: dict[int, str], key: str, unit: str) -> str:
    rows = []
    for row, entry in shown:
        result = entry.stored.result
        value = result.get(key) if key in result else (result.get("statistics") or {}).get(key.rpartition(".")[2])
        if value is not None:
            rows.append((names[id(row)], colours[id(row)], [value / 1e6 if key == "map_bytes" else value]))
    return charts.bars(rows, unit)
