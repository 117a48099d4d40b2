"""The subcommand: builds the replay of a log and runs or checks it."""

import sys
import tempfile
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from knotwork.core import config, graph
from knotwork.core.cli.main import main
from knotwork.core.contracts import Command
from knotwork.core.errors import InputError
from knotwork.core.registry import Registry
from knotwork.core.runtime import Run
from knotwork.plugins.commands.replay.comparison import Comparison
from knotwork.plugins.commands.replay.stored import Stored, as_replay, stored

_FILE = "replay.yaml"  # the pipeline as it is run, in the run's folder


class Replay(Command):
    """`knotwork replay FILE`."""

    def arguments(self, parser: Any) -> None:
        """Add the arguments."""
        parser.add_argument("file", type=Path, metavar="FILE", help="log of a run; 'log.*.mcap' for one in parts")
        parser.add_argument(
            "--check", action="store_true", help="compare with what the log has, name the first difference; no sinks"
        )
        parser.add_argument("--out", metavar="DIR", help="folder for what the run writes (default FILE's, /replay)")
        parser.add_argument("--rate", metavar="max|N", help="speed relative to the sensors' (default max)")
        parser.add_argument("--from", dest="start", type=float, default=0.0, metavar="S", help="begin S seconds in")
        parser.add_argument("--to", dest="stop", type=float, metavar="S", help="end S seconds in")
        parser.add_argument(
            "--set",
            dest="overrides",
            metavar="KEY=VALUE",
            action="append",
            default=[],
            help="override one value of the logged pipeline; may be repeated",
        )
        parser.add_argument("--quiet", action="store_true", help="only warnings and errors")

    def run(self, arguments: Any) -> int:
        """Replay or check; returns 0 done or identical, 1 failed or different, 2 wrong input."""
        if arguments.check and (arguments.start or arguments.stop is not None):
            raise InputError("--check compares a run from its beginning: not with --from, --to")
        run = stored(arguments.file.absolute(), Registry())
        if arguments.check:
            with tempfile.TemporaryDirectory(prefix="knotwork-check-") as folder:
                return _check(arguments, run, Path(folder))
        data = as_replay(run, sinks=True, start=arguments.start, stop=arguments.stop)
        out = Path(arguments.out) if arguments.out else arguments.file.parent / "replay"
        path = _written(data, out)
        argv = ["run", str(path), "--out", str(out), *(["--rate", arguments.rate] if arguments.rate else [])]
        argv += [part for text in arguments.overrides for part in ("--set", text)]
        return main([*argv, *(["--quiet"] if arguments.quiet else [])])


def _written(data: dict[str, Any], out: Path) -> Path:
    try:
        out.mkdir(parents=True, exist_ok=True)
        path = out / _FILE
        path.write_text(config.dump(data))
    except OSError as error:
        raise InputError(f"cannot make or write the folder: {error.strerror}", where=str(out)) from error
    return path


def _check(arguments: Any, run: Stored, out: Path) -> int:
    path = _written(as_replay(run, sinks=False), out)
    registry = Registry()
    pipeline = config.load(path, registry, overrides=arguments.overrides)
    wired = graph.build(pipeline)

    def tell(node: str, level: str, text: str) -> None:
        if not arguments.quiet and level in ("warning", "error"):
            sys.stderr.write(f"{node}: {text}\n")

    execution = Run(pipeline, wired, registry, out, console=tell)
    computed = {name for name, node in pipeline.nodes.items() if node.plugin != "mcap-log"}
    if not computed:
        raise InputError("its pipeline computes nothing: there is nothing to check", where=str(run.path))
    if run.cut and run.cut[0]:
        raise InputError("is a later part of a run: what came before it cannot be known", where=str(run.path))
    whole = run.logs[-1].damage.complete and not run.cut
    comparison = Comparison(run.logs, computed, _recorded(run), whole, lambda: execution.stop("a difference"))
    execution.tap(comparison.see)
    result = execution.execute()
    if result.failure is None:
        comparison.finish()
    n = sum(comparison.same.values())
    found = comparison.difference
    if found is not None:
        sys.stdout.write(f"{run.path}: first difference after {n} identical messages: {found}\n")
        if comparison.missing:
            sys.stdout.write(f"before it the log lacks {comparison.missing} messages that the run had\n")
        return 1
    if result.failure is not None:
        sys.stderr.write(f"knotwork: {result.failure}\n")
        return result.exit_code
    if not n:
        sys.stdout.write(f"{run.path}: it has no message of {', '.join(sorted(computed))}: nothing was compared\n")
        return 1
    streams = ", ".join(f"{stream} {count}" for stream, count in sorted(comparison.same.items()))
    sys.stdout.write(f"{run.path}: identical: {n} messages ({streams})\n")
    for reason, count in ((r, n) for log in run.logs for r, n in log.unreadable.items()):
        sys.stdout.write(f"not compared: {count} messages: {reason}\n")
    if comparison.beyond:
        sys.stdout.write(f"the log was cut short; the run gave {comparison.beyond} messages more\n")
    return 0


def _recorded(run: Stored) -> Any:
    """Return whether a recorder of the run took a stream."""
    rules = [node for node in run.config["nodes"].values() if node.get("plugin") == "mcap"]

    def taken(stream: str) -> bool:
        return not rules or any(
            any(fnmatchcase(stream, pattern) for pattern in rule.get("include", ["*"]))
            and not any(fnmatchcase(stream, pattern) for pattern in rule.get("exclude", []))
            for rule in rules
        )

    return taken
