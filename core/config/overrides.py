"""`--set KEY=VALUE`: one value put into the tree, by a dotted path."""

from dataclasses import dataclass, replace

from knotwork.core.config.sources import Sources
from knotwork.core.config.tree import (
    MAX_DEPTH,
    Item,
    Path,
    Problems,
    container,
    dotted,
    is_secret,
    one_line,
    short,
)
from knotwork.core.config.yaml_source import compose
from knotwork.core.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Change:
    """A value for a dotted key that stands in another file than the pipeline's; `where` is the key's place."""

    key: str
    value: Item
    where: str


TOP = ("pipeline", "description", "clock", "rate", "seed", "vars", "nodes")


def override(root: Item, argument: str, problems: Problems) -> Item:
    """Return the tree with `argument` applied; what is wrong with it goes to `problems`.

    Parameters
    ----------
    argument
        `KEY=VALUE`: `nodes.map.resolution.0=0.5`, `nodes.map.plugin=grid`, `nodes.recorder=~`,
        `vars.log=a.clf`. VALUE is read by the strict YAML loader.
    """
    key, equals, text = argument.partition("=")
    path: Path = tuple(key.strip().split("."))
    where = label(argument)
    if not equals or not key.strip() or "" in path or len(path) >= MAX_DEPTH:
        problems.add(where, "", "expected KEY=VALUE with a dotted key", "for example --set nodes.map.plugin=grid")
        return root
    if not text.strip():
        problems.add(where, path, "the value is empty", "~ is null, '' is an empty text")
        return root
    inner = Problems()
    try:
        value = compose(text, lambda line, column: where, inner)
    except ConfigError:
        value = None  # `inner` holds why
    for problem in inner.found:
        problems.add(where, path, problem.message, problem.hint)
    if value is None or inner.found:
        return root
    return _Override(where, path, value, problems).apply(root)


def change(root: Item, one: Change, problems: Problems) -> Item:
    """Return the tree with a change applied; what is wrong with it goes to `problems`."""
    path: Path = tuple(one.key.split("."))
    if "" in path or len(path) >= MAX_DEPTH:
        problems.add(one.where, "", f"{one.key!r} is no dotted key", "for example nodes.map.plugin")
        return root
    return _Override(one.where, path, one.value, problems).apply(root)


def label(argument: str) -> str:
    """Return the argument as it is shown: cut to a readable length, secrets masked."""
    key, equals, text = argument.partition("=")
    holds_secret = is_secret(key) or any(is_secret(part) for part in text.split(":")[:-1])  # {token: x}
    shown = "***" if holds_secret else text
    line = one_line(f"--set {key}{equals}{shown}")
    return line if len(line) <= 100 else line[:97] + "..."


class _Override:
    def __init__(self, where: str, path: Path, value: Item, problems: Problems) -> None:
        self.where = where
        self.path = path
        self.value = replace(value, key=where)
        self.problems = problems

    def apply(self, root: Item) -> Item:
        top, *rest = self.path
        if top == "include":
            self._wrong("include cannot be set from here", "name the file on the command line instead")
        elif top not in TOP:
            self._wrong(f"unknown key {str(top)!r}", self.problems.nearest(top, TOP))
        elif not rest or self._is_known(root, str(top), str(rest[0])):
            return self._put(root, 0) or root
        return root

    def _is_known(self, root: Item, section: str, name: str) -> bool:
        """Say whether a variable or node exists, or is a new node with its plugin; else add a problem."""
        item = root.child(section)
        known = item.mapping() if item else {}
        if name in known or section not in ("vars", "nodes"):
            return True
        hint = self.problems.nearest(name, known)
        if section == "vars":
            self._wrong(f"unknown variable {name!r}", hint)
            return False
        if self.value.child("plugin") if len(self.path) == 2 else self.path[2:] == ("plugin",):
            return True
        self._wrong(f"unknown node {name!r}", hint or f"a new node begins with --set nodes.{name}.plugin=NAME")
        return False

    def _put(self, item: Item, index: int) -> Item | None:
        """Return `item` with the value at `path[index:]`; None if that cannot be."""
        if index == len(self.path):
            merges = self.path in (("nodes",), ("vars",))
            return Sources(self.problems).merge(item, self.value, self.path) if merges else self.value
        part = self.path[index]
        below = dotted(self.path[:index])
        if isinstance(item.value, list):
            position = int(part) if str(part).isascii() and str(part).isdigit() and len(str(part)) < 9 else -1
            if not 0 <= position < len(item.value):
                valid = f"expected an index 0 to {len(item.value) - 1}" if item.value else "it is empty"
                self._wrong(f"{below} is a list, {valid}, got {short(part)}")
                return None
            changed = self._put(item.value[position], index + 1)
            if changed is None:
                return None
            elements = [*item.value[:position], changed, *item.value[position + 1 :]]
            return container(elements, item.where, key=item.key, via=item.via)
        if item.value is not None and not isinstance(item.value, dict):
            self._wrong(f"{below} is {short(item.value)}, which has no {short(part)}", f"set {below} as a whole")
            return None
        return self._put_entry(item, str(part), index)

    def _put_entry(self, item: Item, part: str, index: int) -> Item | None:
        entries = dict(item.mapping())
        last = index + 1 == len(self.path)
        if last and index == 1 and self.path[0] == "nodes" and self.value.value is None:
            del entries[part]
            return container(entries, item.where, key=item.key, via=item.via)
        missing = entries.get(part)
        if missing is None and part.isdigit():
            below = dotted(self.path[:index])
            self._wrong(f"{below} is not written as a list in the file", f"set {below} as a whole")
            return None
        changed = self._put(missing or container({}, self.where, key=self.where), index + 1)
        if changed is None:
            return None
        entries[part] = changed if missing is None or last else replace(changed, key=missing.key)
        return container(entries, item.where, key=item.key, via=item.via)

    def _wrong(self, message: str, hint: str = "") -> None:
        self.problems.add(self.where, self.path, message, hint)
