"""The table: a row for each combination of values, as Markdown, CSV and JSON."""

import csv
import io
import statistics
from dataclasses import dataclass, field
from typing import Any

from knotwork.plugins.commands.ablate.metrics import Figure, Metric
from knotwork.plugins.commands.ablate.plan import Plan, Run
from knotwork.plugins.commands.ablate.scores import Scores
from knotwork.plugins.commands.ablate.store import Stored


@dataclass(frozen=True, slots=True)
class Entry:
    """A run with what is stored and how it scored."""

    run: Run
    stored: Stored
    scores: Scores

    @property
    def state(self) -> str:
        """`done`, `failed` or `not run`."""
        if self.stored.finished:
            return "done"
        return "failed" if self.stored.result else "not run"

    def figure(self, metric: Metric) -> Figure:
        """Return the run's figure of a metric."""
        return metric.of(self.stored.result, self.scores.figures) if self.stored.finished else None


@dataclass(slots=True)
class Row:
    """A line of the table: one run, or the runs that are averaged."""

    names: dict[str, str]
    entries: list[Entry] = field(default_factory=list)
    figures: dict[str, Figure] = field(default_factory=dict)

    @property
    def state(self) -> str:
        """`done`, or how many of its runs are not."""
        states = [entry.state for entry in self.entries]
        if len(states) == 1:
            return states[0]
        counts = [f"{states.count(state)} {state}" for state in ("failed", "not run") if state in states]
        return ", ".join(counts) or "done"


def rows_of(plan: Plan, entries: list[Entry]) -> list[Row]:
    """Return the rows in the order of the axes; with several runs in one, mean and deviation are over the runs."""
    rows: dict[tuple[str, ...], Row] = {}
    shown = [axis for axis in plan.axes if axis not in plan.average]
    for entry in entries:
        names = {axis: entry.run.names[axis] for axis in shown}
        rows.setdefault(tuple(names.values()), Row(names)).entries.append(entry)
    for row in rows.values():
        for metric in plan.metrics:
            row.figures[metric.name] = _combined([entry.figure(metric) for entry in row.entries])
    return list(rows.values())


def _combined(figures: list[Figure]) -> Figure:
    known = [figure for figure in figures if figure is not None]
    if len(known) < 2:
        return known[0] if known else None
    means = [mean for mean, _ in known]
    return statistics.fmean(means), statistics.pstdev(means)


def text_of(metric: Metric, figure: Figure) -> str:
    """Return a figure as the table shows it."""
    if figure is None:
        return "-"
    mean, deviation = (None if part is None else _number(part, metric.digits) for part in figure)
    return f"{mean} ± {deviation}" if deviation is not None else str(mean)


def _number(value: float, digits: int) -> str:
    if digits < 0:
        return f"{value:.6g}"
    return f"{value:,.{digits}f}" if abs(value) < 1e6 or not digits else f"{value:.3g}"


def markdown(plan: Plan, rows: list[Row]) -> str:
    """Return the table as Markdown; `state` is there only if a run is not done."""
    axes = [axis for axis in plan.axes if axis not in plan.average]
    incomplete = any(row.state != "done" for row in rows)
    head = [*axes, *(metric.head for metric in plan.metrics), *(["state"] if incomplete else [])]
    lines = ["| " + " | ".join(head) + " |"]
    lines.append("| " + " | ".join(["---"] * len(axes) + ["---:"] * len(plan.metrics) + ["---"] * incomplete) + " |")
    for row in rows:
        cells = [*row.names.values(), *(text_of(metric, row.figures[metric.name]) for metric in plan.metrics)]
        lines.append("| " + " | ".join(_cell(cell) for cell in [*cells, *([row.state] if incomplete else [])]) + " |")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def comma_separated(plan: Plan, rows: list[Row]) -> str:
    """Return the table as CSV: full digits, a column more for each deviation there is, empty where nothing is known."""
    spread = {
        metric.name: any((figure := row.figures[metric.name]) and figure[1] is not None for row in rows)
        for metric in plan.metrics
    }
    axes = [axis for axis in plan.axes if axis not in plan.average]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    head = [name for metric in plan.metrics for name in (metric.name, f"{metric.name}_std")[: 1 + spread[metric.name]]]
    writer.writerow([*axes, "state", *head])
    for row in rows:
        cells: list[Any] = []
        for metric in plan.metrics:
            mean, deviation = row.figures[metric.name] or (None, None)
            cells += [mean, deviation][: 1 + spread[metric.name]]
        writer.writerow([*row.names.values(), row.state, *("" if cell is None else cell for cell in cells)])
    return out.getvalue()


def as_json(plan: Plan, rows: list[Row], facts: dict[str, Any]) -> dict[str, Any]:
    """Return everything the table holds as plain data."""
    return {
        "ablation": plan.name,
        "description": plan.description,
        **facts,
        "axes": plan.axes,
        "average": list(plan.average),
        "metrics": {metric.name: metric.head for metric in plan.metrics},
        "rows": [
            {
                "names": row.names,
                "state": row.state,
                "metrics": {
                    name: None if figure is None else {"mean": figure[0], "std": figure[1]}
                    for name, figure in row.figures.items()
                },
                "runs": [
                    {
                        "names": entry.run.names,
                        "digest": entry.run.digest,
                        "folder": f"runs/{entry.stored.folder.name}",
                        "state": entry.state,
                        "error": entry.stored.error,
                        "not_scored": entry.scores.problems,
                    }
                    for entry in row.entries
                ],
            }
            for row in rows
        ],
    }
