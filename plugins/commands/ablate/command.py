"""The subcommand: plan, run what is missing, write table and report."""

import json
import os
import signal
import sys
from contextlib import AbstractContextManager
from pathlib import Path
from types import FrameType
from typing import Any

from knotwork.core import clock
from knotwork.core.contracts import Command
from knotwork.core.errors import InputError
from knotwork.core.files import write_atomic
from knotwork.core.registry import Registry
from knotwork.plugins.commands.ablate import engines
from knotwork.plugins.commands.ablate.job import Job
from knotwork.plugins.commands.ablate.plan import Plan, Run, read_plan, version_of
from knotwork.plugins.commands.ablate.progress import Progress
from knotwork.plugins.commands.ablate.report import report
from knotwork.plugins.commands.ablate.scores import score
from knotwork.plugins.commands.ablate.store import Store
from knotwork.plugins.commands.ablate.table import Entry, as_json, comma_separated, markdown, rows_of


class Ablate(Command):
    """`ablate FILE`."""

    def arguments(self, parser: Any) -> None:
        """Add FILE and the options."""
        parser.add_argument(
            "file", metavar="FILE", help="ablation file (YAML); configs:ablations/NAME for a shipped one"
        )
        parser.add_argument("--out", metavar="DIR", help="folder for runs, table and report (default runs/ablate-NAME)")
        parser.add_argument(
            "--set",
            dest="overrides",
            metavar="KEY=VALUE",
            action="append",
            default=[],
            help="a variable of FILE (vars.data=/my/logs), or a config key of every run (nodes.log.limit=500)",
        )
        parser.add_argument(
            "--jobs",
            type=int,
            metavar="N",
            help="runs at a time, each in its own process (default: one a core); 0: in this process",
        )
        parser.add_argument("--scheduler", metavar="ADDRESS", help="run on a Dask cluster: tcp://HOST:8786")
        parser.add_argument("--check", action="store_true", help="check everything, list the runs, run nothing")
        parser.add_argument("--again", action="store_true", help="run all, also what was finished before")
        parser.add_argument("--json", action="store_true", help="print the results as JSON instead of the table")
        parser.add_argument("--quiet", action="store_true", help="no progress, failures only")

    def run(self, arguments: Any) -> int:
        """Return 0 when all runs are done, 1 when some failed, 130 when it was interrupted."""
        if arguments.jobs is not None and arguments.jobs < 0:
            raise InputError(f"expected 0 or more, found {arguments.jobs}", where="--jobs")
        if arguments.jobs is not None and arguments.scheduler:
            raise InputError("--jobs and --scheduler exclude each other", where="--jobs")
        plan = read_plan(arguments.file, Registry(), arguments.overrides)
        out = Path(arguments.out or f"runs/ablate-{plan.name}").absolute()
        if arguments.check:
            return _list(plan, out)
        store = Store(out)
        todo = _todo(plan, store, arguments.again)
        previous = signal.signal(signal.SIGTERM, _interrupt)
        interrupted, where = False, "nothing to run"
        try:
            if todo:
                with _engine(arguments) as engine:
                    where = engine.name
                    _execute(engine, todo, store, len(plan.runs), arguments.quiet or arguments.json)
        except KeyboardInterrupt:
            interrupted = True
            sys.stderr.write("interrupted: finished runs are kept, the same command goes on from here\n")
        finally:
            signal.signal(signal.SIGTERM, previous)
        failed = _write(plan, store, where, print_json=arguments.json)
        return 130 if interrupted else int(failed)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _todo(plan: Plan, store: Store, again: bool) -> dict[str, Run]:
    """Return the runs that have no result yet, by digest: equal runs are run once."""
    return {run.digest: run for run in plan.runs if again or not store.get(run).finished}


def _engine(arguments: Any) -> AbstractContextManager[engines.Engine]:
    if arguments.scheduler:
        return engines.dask(arguments.scheduler)
    if arguments.jobs == 0:
        return engines.in_this_process()
    return engines.processes(arguments.jobs or os.cpu_count() or 1)


def _execute(engine: engines.Engine, todo: dict[str, Run], store: Store, total: int, quiet: bool) -> None:
    same = total - len(todo)
    progress = Progress(total, same, quiet)
    if not quiet:
        before = f", {same} finished before or equal to another" if same else ""
        progress.line(f"{total} runs{before}; {engine.name}")
    progress.tick()
    by_folder = {str(store.get(run).folder): run for run in todo.values()}
    jobs = [Job(run.pipeline, folder) for folder, run in by_folder.items()]
    begun = clock.monotonic()
    try:
        for ended in engines.completed(engine, jobs):
            if ended is None:
                progress.tick()
                continue
            job, outcome = ended
            run = by_folder[job.out]
            stored = store.keep(run, outcome)
            progress.ended(run.title, stored.error, stored.result.get("statistics", {}).get("wall_s"))
    finally:
        progress.close()
    if not quiet:
        sys.stderr.write(f"{len(jobs)} runs in {(clock.monotonic() - begun) / 1e9:.0f} s\n")


def _write(plan: Plan, store: Store, where: str, *, print_json: bool) -> bool:
    """Write table.md, table.csv, results.json and report.html; return whether a run failed."""
    entries = [Entry(run, stored := store.get(run), score(run, stored)) for run in plan.runs]
    rows = rows_of(plan, entries)
    notes = _notes(entries)
    facts = {"versions": [version_of(name) for name in ("knotwork", "numpy", "numba")], "ran": where, "notes": notes}
    results = as_json(plan, rows, facts)
    table = markdown(plan, rows)
    text = f"# {plan.name}\n\n{plan.description}\n\n{table}" + "".join(f"\n- {note}" for note in notes)
    write_atomic(store.out / "table.md", (text.rstrip() + "\n").encode())
    write_atomic(store.out / "table.csv", comma_separated(plan, rows).encode())
    write_atomic(store.out / "results.json", (json.dumps(results, indent=1) + "\n").encode())
    write_atomic(store.out / "report.html", report(plan, rows, facts).encode())
    if print_json:
        sys.stdout.write(json.dumps(results, indent=1) + "\n")
    else:
        sys.stdout.write(table + "".join(f"- {note}\n" for note in notes))
        sys.stdout.write(f"{store.out}: report.html, results.json, table.csv, table.md\n")
    return any(entry.state == "failed" for entry in entries)


def _notes(entries: list[Entry]) -> list[str]:
    notes = [f"{entry.run.title} failed: {entry.stored.error}" for entry in entries if entry.state == "failed"]
    unscored = (f"{e.run.title} is not scored: {problem}" for e in entries for problem in e.scores.problems)
    missing = sum(entry.state == "not run" for entry in entries)
    return [*notes, *unscored, *([f"{missing} runs were not run"] if missing else [])]


def _list(plan: Plan, out: Path) -> int:
    store = Store(out) if out.is_dir() else None
    for run in plan.runs:
        stored = store.get(run) if store else None
        state = "finished" if stored and stored.finished else "failed" if stored and stored.result else "to run"
        sys.stdout.write(f"{state:<10}{run.digest}  {run.title}\n")
    sys.stdout.write(f"ok: {plan.name}: {len(plan.runs)} runs of {plan.base}\n")
    return 0
