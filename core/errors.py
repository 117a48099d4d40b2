"""The errors a user meets: one line that says what, where, what was expected and what to do."""

from dataclasses import dataclass


class KnotworkError(Exception):
    """Base of every error that is shown to the user as a line, never as a traceback.

    Parameters
    ----------
    message
        What is wrong and what was expected.
    where
        `file:line:column`, a port, a byte offset, a command-line argument.
    hint
        What to do about it.
    """

    exit_code = 1

    def __init__(self, message: str, *, where: str = "", hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.where = where
        self.hint = hint

    def __str__(self) -> str:
        """Render as one line."""
        text = f"{self.where}: {self.message}" if self.where else self.message
        return f"{text} ({self.hint})" if self.hint else text


class InputError(KnotworkError):
    """The user's input was wrong: a file, a key, an argument. Exit code 2."""

    exit_code = 2


@dataclass(frozen=True, slots=True)
class Problem:
    """One finding in a configuration; a list of them is reported at once."""

    where: str  # file:line:column or the command-line argument
    path: str  # nodes.map.resolution
    message: str  # what is wrong, what was expected
    hint: str = ""  # nearest valid name, what to do

    def __str__(self) -> str:
        """Render as `where: path: message (hint)`."""
        text = ": ".join(part for part in (self.where, self.path, self.message) if part)
        return f"{text} ({self.hint})" if self.hint else text


class ConfigError(InputError):
    """A configuration with one or more problems, all of them listed."""

    def __init__(self, problems: list[Problem]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = problems


class NodeError(KnotworkError):
    """A node of a running pipeline failed; carries the node's name."""

    def __init__(self, node: str, message: str, *, hint: str = "") -> None:
        super().__init__(message, where=f"node {node}", hint=hint)
        self.node = node


class DriverError(KnotworkError):
    """A device or log cannot be opened or read (missing, empty, another format, unplugged)."""
