"""The subcommands of `knotwork log`; each is a module with `arguments(parser)` and `run(arguments)`."""

from collections.abc import Callable
from typing import Any

from knotwork.core.contracts import Command
from knotwork.plugins.commands.log import check, cut, info, merge, recover

_SUBCOMMANDS = {"info": info, "check": check, "recover": recover, "cut": cut, "merge": merge}


class LogCommand(Command):
    """`knotwork log info | check | recover | cut | merge FILE`."""

    def arguments(self, parser: Any) -> None:
        """Add a subparser for each subcommand."""
        subparsers = parser.add_subparsers(dest="log_command", metavar="COMMAND", required=True)
        for name, module in _SUBCOMMANDS.items():
            summary = (module.__doc__ or "").splitlines()[0]
            module.arguments(subparsers.add_parser(name, help=summary, description=summary))

    def run(self, arguments: Any) -> int:
        """Run the chosen one."""
        run: Callable[[Any], int] = _SUBCOMMANDS[arguments.log_command].run
        return run(arguments)
