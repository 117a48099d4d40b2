"""`knotwork`: finds the subcommand, runs it, turns errors into one line and an exit code.

Exit codes: 0 done, 1 it failed, 2 the user's input was wrong.
"""

import argparse
import difflib
import importlib
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from knotwork.core.errors import KnotworkError


@dataclass(frozen=True, slots=True)
class Subcommand:
    """One subcommand; its module or class is imported only when it is called."""

    name: str
    summary: str
    path: str  # a module with `arguments(parser)` and `run(arguments)`, or `module:Class` of a command plugin


OWN = (
    Subcommand("run", "run a pipeline", "knotwork.core.cli.run"),
    Subcommand("validate", "check a pipeline file without opening a device", "knotwork.core.cli.validate"),
    Subcommand("graph", "show how a pipeline is wired", "knotwork.core.cli.graph"),
    Subcommand("config", "show a pipeline's resolved configuration", "knotwork.core.cli.config"),
    Subcommand("plugins", "list the plugins installed here, or describe one", "knotwork.core.cli.plugins"),
    Subcommand("schema", "print the JSON Schema of a pipeline file", "knotwork.core.cli.schema"),
    Subcommand("new", "make a third-party plugin package from a template", "knotwork.core.cli.new"),
    Subcommand("warm", "compile all kernels now, so that the first run starts at once", "knotwork.core.cli.warm"),
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        return _main(arguments)
    except KnotworkError as error:
        for line in str(error).splitlines():
            sys.stderr.write(f"knotwork: {line}\n")
        return error.exit_code
    except BrokenPipeError:
        # Whoever read our output has gone; say nothing more, not even at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        sys.stderr.write("knotwork: interrupted\n")
        return 130


def _main(argv: list[str]) -> int:
    name = next((a for a in argv if not a.startswith("-")), None)
    own = next((c for c in OWN if c.name == name), None)
    if own is not None and argv[0] == name:
        return _call(own, argv[1:])
    if argv[:1] == ["--version"]:
        sys.stdout.write(f"knotwork {importlib.import_module('knotwork').__version__}\n")
        return 0
    commands = [*OWN, *_from_plugins()]
    found = next((c for c in commands if c.name == name), None)
    if found is not None and argv[0] == name:
        return _call(found, argv[1:])
    parser = _parser(commands)
    if not argv:
        parser.print_help()
        return 2
    if name is not None and argv[0] == name:
        close = difflib.get_close_matches(name, [c.name for c in commands], n=1)
        hint = f"did you mean {close[0]!r}?" if close else "`knotwork --help` lists them"
        sys.stderr.write(f"knotwork: no command {name!r} ({hint})\n")
        return 2
    return _exit_code(lambda: parser.parse_args(argv))


def _parser(commands: Sequence[Subcommand]) -> argparse.ArgumentParser:
    width = max(len(c.name) for c in commands) + 2
    listed = "\n".join(f"  {c.name:<{width}}{c.summary}" for c in commands)
    parser = argparse.ArgumentParser(
        prog="knotwork",
        usage="knotwork COMMAND ... | --help | --version",
        description="Compose, run, compare and trust a robot's perception from one YAML file.",
        epilog=f"commands:\n{listed}\n\n`knotwork COMMAND --help` says more of one.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="store_true", help="print the version")
    return parser


def _call(command: Subcommand, argv: list[str]) -> int:
    module, _, name = command.path.partition(":")
    target: Any = importlib.import_module(module)
    if name:
        target = getattr(target, name)()
    parser = argparse.ArgumentParser(prog=f"knotwork {command.name}", description=command.summary)
    target.arguments(parser)
    parsed: list[argparse.Namespace] = []
    code = _exit_code(lambda: parsed.append(parser.parse_args(argv)))
    return int(target.run(parsed[0])) if parsed else code


def _exit_code(parse: Any) -> int:
    try:
        parse()
    except SystemExit as exit_:
        return int(exit_.code or 0)
    return 0


def _from_plugins() -> list[Subcommand]:
    from knotwork.core.registry import Registry

    records = Registry().records("command")
    return [Subcommand(r.name, r.manifest.summary, r.manifest.impl) for r in records if r.manifest and not r.cause]
