"""What a command must do."""

import argparse

import pytest

from knotwork.core.conformance.suite import PluginSuite


class CommandSuite(PluginSuite):
    """Checks of subcommands."""

    kind = "command"

    def parser(self) -> argparse.ArgumentParser:
        """Return the parser that the command line would build."""
        parser = argparse.ArgumentParser(prog=f"knotwork {self.manifest.name}", description=self.manifest.summary)
        self.implementation()().arguments(parser)
        return parser

    def test_help(self, capsys: pytest.CaptureFixture[str]) -> None:
        """`--help` prints the summary and ends with 0."""
        with pytest.raises(SystemExit) as ended:
            self.parser().parse_args(["--help"])
        assert ended.value.code == 0
        assert self.manifest.summary.split()[0] in capsys.readouterr().out

    def test_every_argument_is_explained(self) -> None:
        """Each argument has a help text."""
        for parser in _parsers(self.parser()):
            for action in parser._actions:
                if isinstance(action, argparse._SubParsersAction):
                    continue  # its choices are explained one by one
                assert action.help, f"{'/'.join(action.option_strings) or action.dest} has no help"

    def test_unknown_argument(self) -> None:
        """A mistyped argument ends with exit code 2."""
        with pytest.raises(SystemExit) as ended:
            self.parser().parse_args(["--no-such-argument-exists"])
        assert ended.value.code == 2


def _parsers(parser: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    found = [parser]
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            found += [p for choice in action.choices.values() for p in _parsers(choice)]
    return found
