"""The subcommands of `knotwork data`; each is a module with `arguments(parser)` and `run(arguments)`."""

from typing import Any

from knotwork.core.contracts import Command
from knotwork.plugins.commands.data import convert, fetch, info, listing

_SUBCOMMANDS: dict[str, Any] = {"list": listing, "fetch": fetch, "info": info, "convert": convert}


class DataCommand(Command):
    """`knotwork data list | fetch NAME | info FILE | convert FILE`."""

    def arguments(self, parser: Any) -> None:
        """Add a subparser for each subcommand."""
        subparsers = parser.add_subparsers(dest="data_command", metavar="COMMAND", required=True)
        for name, module in _SUBCOMMANDS.items():
            summary = (module.__doc__ or "").splitlines()[0]
            module.arguments(subparsers.add_parser(name, help=summary, description=summary))

    def run(self, arguments: Any) -> int:
        """Run the chosen one."""
        code: int = _SUBCOMMANDS[arguments.data_command].run(arguments)
        return code
