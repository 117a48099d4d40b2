"""A configuration as a tree whose every value knows where it stands, and the list of its problems."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from knotwork.core.errors import ConfigError, Problem

Scalar = str | int | float | bool | None
Path = tuple[str | int, ...]

MAX_SIZE = 200_000  # values of one configuration, aliases and references counted each time
MAX_DEPTH = 40
MAX_HINTS = 50  # problems that get a hint, and problems that are shown
_PLACE = re.compile(r"(.*):(\d+):(\d+)\Z")
SECRET = ("token", "password", "secret")


@dataclass(frozen=True, slots=True)
class Item:
    """One value.

    Attributes
    ----------
    value
        A scalar, a list or a mapping of Items.
    where
        `file:line:column` or the command-line argument.
    key
        Where its key stands; empty outside a mapping.
    via
        What it came through: `var log`, `env HOME`, `default of ${NAME}`.
    text
        The text as it was before it was read as a number, for values from the environment.
    broken
        A problem has been reported for it; nothing more is said about it.
    size, depth
        Number of values in it, levels below it; a long text counts as several.
    """

    value: "Scalar | list[Item] | dict[str, Item]"
    where: str
    key: str = ""
    via: tuple[str, ...] = ()
    text: str | None = None
    broken: bool = False
    size: int = 1
    depth: int = 0

    @property
    def position(self) -> str:
        """Where a person should look: the key of a mapping, the value of anything else."""
        return self.key if self.key and isinstance(self.value, dict) else self.where

    def mapping(self) -> "dict[str, Item]":
        """Return its entries; none if it is no mapping."""
        return self.value if isinstance(self.value, dict) else {}

    def child(self, part: str | int) -> "Item | None":
        """Return the entry under a key or an index."""
        if isinstance(self.value, dict):
            return self.value.get(str(part))
        if isinstance(self.value, list) and isinstance(part, int) and 0 <= part < len(self.value):
            return self.value[part]
        return None

    def at(self, path: Path) -> "Item | None":
        """Return the value at a path below."""
        item: Item | None = self
        for part in path:
            item = item.child(part) if item is not None else None
        return item

    def nearest(self, path: Path) -> "Item":
        """Return the value at a path below, or at the longest part of it that exists."""
        item = self
        for part in path:
            child = item.child(part)
            if child is None:
                break
            item = child
        return item

    def walk(self, path: Path = ()) -> "Iterator[tuple[Path, Item]]":
        """Yield every value with its path, parents first."""
        yield path, self
        if isinstance(self.value, dict):
            for name, child in self.value.items():
                yield from child.walk((*path, name))
        elif isinstance(self.value, list):
            for index, child in enumerate(self.value):
                yield from child.walk((*path, index))


def scalar(value: Scalar, where: str, *, via: tuple[str, ...] = (), text: str | None = None) -> Item:
    """Make a scalar."""
    size = 1 + len(value) // 32 if isinstance(value, str) else 1
    return Item(value, where, via=via, text=text, size=size)


def broken(item: Item) -> Item:
    """Make the stand-in of a value that has a problem."""
    return Item(None, item.where, item.key, item.via, broken=True)


def container(value: list[Item] | dict[str, Item], where: str, *, key: str = "", via: tuple[str, ...] = ()) -> Item:
    """Make a list or a mapping; its size and depth follow from its entries."""
    size, depth = 1, 0
    for child in value.values() if isinstance(value, dict) else value:
        size += child.size
        depth = max(depth, child.depth + 1)
    return Item(value, where, key, via, size=size, depth=depth)


def plain(item: Item, as_text: frozenset[Path] = frozenset(), path: Path = ()) -> Any:
    """Return the value without positions; leaves in `as_text` as the text they were written as."""
    if isinstance(item.value, dict):
        return {name: plain(child, as_text, (*path, name)) for name, child in item.value.items()}
    if isinstance(item.value, list):
        return [plain(child, as_text, (*path, index)) for index, child in enumerate(item.value)]
    return item.text if path in as_text and item.text is not None else item.value


def dotted(path: Path) -> str:
    """Return `nodes.map.resolution.0`."""
    return ".".join(str(part) for part in path)


def is_secret(name: object) -> bool:
    """Say whether the value of a key must not be shown."""
    return any(word in str(name).lower() for word in SECRET)


def short(value: Any) -> str:
    """Return a value for a message, cut to a readable length."""
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return f"a list of {len(value)}" if len(value) != 1 else "a list of 1"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    text = repr(value[:61] if isinstance(value, str) else value)
    return text if len(text) <= 60 else text[:57] + "..."


def one_line(text: str) -> str:
    """Return a text that cannot break the line or the terminal it is shown on."""
    return text if text.isprintable() else "".join(one if one.isprintable() else ascii(one)[1:-1] for one in text)


class Problems:
    """Collects what is wrong, so that a person hears of everything at once."""

    def __init__(self) -> None:
        self.found: list[Problem] = []
        self.more = 0

    def add(self, where: str, path: Path | str, message: str, hint: str = "") -> None:
        """Add one problem; a value and place is complained about once."""
        key = path if isinstance(path, str) else dotted(path)
        problem = Problem(*(one_line(text) for text in (where, key, message, hint)))
        if len(self.found) >= MAX_HINTS:
            self.more += 1
        elif problem not in self.found:
            self.found.append(problem)

    def nearest(self, word: object, names: Iterable[str]) -> str:
        """Return the hint that names the nearest valid name, or the valid ones if they are few."""
        known = sorted({name for name in names if name})
        if len(self.found) >= MAX_HINTS or not known:
            return ""
        close = get_close_matches(str(word)[:60], known, n=1, cutoff=0.6)
        if close and close[0] != word:
            return f"did you mean {close[0]!r}?"
        if len(known) <= 12:
            return f"valid: {', '.join(known)}"
        return f"valid: {', '.join(known[:10])}, and {len(known) - 10} more"

    def error(self) -> ConfigError:
        """Return everything found as one error: file by file as they came up, in the order of the lines."""
        places = [_PLACE.match(problem.where) for problem in self.found]
        files = [place[1] if place else problem.where for place, problem in zip(places, self.found, strict=True)]
        lines = [(int(place[2]), int(place[3])) if place else (0, 0) for place in places]
        order = sorted(range(len(self.found)), key=lambda index: (files.index(files[index]), lines[index]))
        more = [Problem("", "", f"and {self.more} more problems")] if self.more else []
        return ConfigError([*(self.found[index] for index in order), *more])

    def fatal(self, where: str, path: Path | str, message: str, hint: str = "") -> ConfigError:
        """Return the error of a problem after which going on makes no sense."""
        self.add(where, path, message, hint)
        return self.error()

    def check(self) -> None:
        """Raise ConfigError if there are problems."""
        if self.found:
            raise self.error()
