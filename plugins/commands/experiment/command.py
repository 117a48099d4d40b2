"""The subcommand: finds the experiment in the table and hands over."""

from importlib import import_module
from typing import Any, Protocol

from knotwork.core.contracts import Command
from knotwork.core.errors import InputError
from knotwork.plugins.commands.experiment.table import EXPERIMENTS


class Entry(Protocol):
    """What an experiment's class does."""

    def arguments(self, parser: Any) -> None:
        """Add its own arguments; --runs, --seed, --out, --json, --jobs are there already."""

    def run(self, arguments: Any) -> int:
        """Do it; return the exit code."""


class Experiment(Command):
    """`experiment NAME`."""

    def arguments(self, parser: Any) -> None:
        """Add one subcommand for each experiment."""
        names = parser.add_subparsers(dest="experiment", required=True, metavar="NAME")
        for name, (path, summary) in EXPERIMENTS.items():
            one = names.add_parser(name, help=summary, description=summary)
            entry = _entry(path)
            runs = getattr(entry, "runs", 1000)
            one.add_argument(
                "--runs", type=int, default=runs, metavar="N", help=f"scenarios of each kind (default {runs})"
            )
            one.add_argument("--seed", type=int, default=0, metavar="S", help="of all random numbers (default 0)")
            one.add_argument("--out", default=f"runs/{name}", metavar="DIR", help=f"default runs/{name}")
            one.add_argument("--jobs", type=int, default=0, metavar="N", help="processes (default: one a core)")
            one.add_argument("--json", action="store_true", help="print the results as JSON")
            one.add_argument("--no-figures", action="store_true", help="numbers only: needs no matplotlib")
            entry.arguments(one)

    def run(self, arguments: Any) -> int:
        """Run the experiment that was named."""
        if arguments.runs < 1:
            raise InputError(f"expected 1 or more, found {arguments.runs}", where="--runs")
        if arguments.seed < 0 or arguments.jobs < 0:
            raise InputError("expected 0 or more", where="--seed" if arguments.seed < 0 else "--jobs")
        return _entry(EXPERIMENTS[arguments.experiment][0]).run(arguments)


def _entry(path: str) -> Entry:
    module, _, name = path.partition(":")
    entry: Entry = getattr(import_module(module), name)()
    return entry
