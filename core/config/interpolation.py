"""References in texts: `${name}`, `${NAME:-default}`, `${env:NAME:-default}`; `$${` is a literal `${`."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from knotwork.core.config.tree import MAX_SIZE, Item, Path, Problems, broken, container, scalar
from knotwork.core.config.yaml_source import read_scalar

MAX_LEVEL = 100  # vars within vars within lists
MAX_NESTED = 8  # defaults within defaults
MAX_TEXT = 1 << 23  # characters put into texts

_TOKEN = re.compile(r"\$\$\{|\$\{")
_NAME = re.compile(r"(env:)?([A-Za-z_][A-Za-z0-9_-]*)\Z")


@dataclass(frozen=True, slots=True)
class Reference:
    """One `${...}`: its name, whether only the environment may answer, and the default if it has one."""

    name: str
    only_environment: bool
    default: str | None


def split(text: str) -> list[str | Reference]:
    """Split a text into literal parts and references.

    Raises
    ------
    ValueError
        A reference that is not closed, has no name or is nested too deeply.
    """
    parts: list[str | Reference] = []
    done = 0
    while token := _TOKEN.search(text, done):
        parts.append(text[done : token.start()])
        if token[0] == "$${":
            parts.append("${")
            done = token.end()
            continue
        end = _closing(text, token.end())
        parts.append(_reference(text[token.end() : end]))
        done = end + 1
    parts.append(text[done:])
    return [part for part in parts if part != ""]


def _closing(text: str, start: int) -> int:
    level = 1
    for token in re.compile(r"\$\$\{|\$\{|\}").finditer(text, start):
        if token[0] == "}":
            level -= 1
        else:
            level += 1
        if level == 0:
            return token.start()
        if level > MAX_NESTED:
            raise ValueError(f"references are nested deeper than {MAX_NESTED}")
    raise ValueError("a reference `${` is not closed by `}`")


def _reference(inside: str) -> Reference:
    name, colon, default = inside.partition(":-")
    matched = _NAME.match(name)
    if not matched:
        raise ValueError(f"${{{inside[:40]}}} is no reference: expected ${{name}}, ${{NAME:-default}} or ${{env:NAME}}")
    return Reference(matched[2], bool(matched[1]), default if colon else None)


def interpolate(root: Item, environment: Mapping[str, str], problems: Problems) -> Item:
    """Return the tree with every reference replaced.

    Parameters
    ----------
    root
        The merged file; its `vars` are looked up before the environment.
    environment
        Usually `os.environ`.
    problems
        Takes unknown names, cycles, malformed references.

    Raises
    ------
    ConfigError
        References that make the configuration too large.
    """
    return _Interpolation(root, environment, problems).expand(root, ())


class _Interpolation:
    def __init__(self, root: Item, environment: Mapping[str, str], problems: Problems) -> None:
        declared = root.child("vars")
        self.vars = declared.mapping() if declared else {}
        self.environment = environment
        self.problems = problems
        self.known: dict[str, Item] = {}
        self.open: list[str] = []
        self.level = 0
        self.spent = 0

    def expand(self, item: Item, path: Path) -> Item:
        if len(path) == 2 and path[0] == "vars" and str(path[1]) in self.vars and not self.open:
            return self._var(str(path[1]), item, path)
        self.level += 1
        if self.level > MAX_LEVEL:
            raise self.problems.fatal(item.where, path, "references are nested too deeply")
        if isinstance(item.value, dict):
            entries = {name: self.expand(child, (*path, name)) for name, child in item.value.items()}
            result = container(entries, item.where, key=item.key, via=item.via)
        elif isinstance(item.value, list):
            elements = [self.expand(child, (*path, index)) for index, child in enumerate(item.value)]
            result = container(elements, item.where, key=item.key, via=item.via)
        elif isinstance(item.value, str) and "${" in item.value:
            result = self._text(item, path)
        else:
            result = item
        self.level -= 1
        if result.size > MAX_SIZE or result.depth > MAX_LEVEL:
            raise self.problems.fatal(item.where, path, "references make the configuration too large")
        return result

    def _text(self, item: Item, path: Path) -> Item:
        assert isinstance(item.value, str)
        try:
            parts = split(item.value)
        except ValueError as error:
            self.problems.add(item.where, path, str(error), "a literal ${ is written $${")
            return broken(item)
        if len(parts) == 1 and isinstance(parts[0], Reference):
            found = self._look_up(parts[0], item, path)
            return replace(found, where=item.where, key=item.key, via=(*item.via, *found.via))
        texts: list[str] = []
        via = list(item.via)
        for part in parts:
            if isinstance(part, str):
                texts.append(part)
                continue
            found = self._look_up(part, item, path)
            via += [one for one in found.via if one not in via]
            if found.broken:
                return broken(item)
            if isinstance(found.value, dict | list) or found.value is None:
                what = "null" if found.value is None else "a list or mapping"
                self.problems.add(item.where, path, f"${{{part.name}}} is {what} and cannot stand inside a text")
                return broken(item)
            texts.append(found.text if found.text is not None else _written(found.value))
            self.spent += len(texts[-1])
            if self.spent > MAX_TEXT:
                raise self.problems.fatal(item.where, path, "references make the configuration too large")
        text = "".join(texts)
        return replace(scalar(text, item.where, via=tuple(via)), key=item.key)

    def _look_up(self, reference: Reference, item: Item, path: Path) -> Item:
        name = reference.name
        if name in self.vars and not reference.only_environment:
            declared = self.vars[name]
            found = self._var(name, item, path)
            if declared.value is not None or declared.broken:
                via = f"var {name} ({declared.where})"
                return replace(found, via=(via, *found.via))
            if reference.default is None:
                self.problems.add(item.where, path, f"the variable {name!r} must be given", f"--set vars.{name}=VALUE")
                return broken(item)
        else:
            text = self.environment.get(name)
            if text or (text is not None and reference.default is None):
                return self._typed(text, f"env {name}", item, path)
        if reference.default is not None:
            default = self.expand(scalar(reference.default, item.where), path)
            if isinstance(default.value, str) and not default.via:
                default = self._typed(default.value, "", item, path)
            return replace(default, via=(*default.via, f"default of ${{{name}}}"))
        kind = "environment variable" if reference.only_environment else "variable"
        declared_names = [] if reference.only_environment else [one for one in self.vars if one != name]
        hint = self.problems.nearest(name, [*declared_names, *self.environment])
        if not hint.startswith("did you mean"):
            hint = f"set it, or write ${{{name}:-DEFAULT}}"
        self.problems.add(item.where, path, f"there is no {kind} {name!r}", hint)
        return broken(item)

    def _var(self, name: str, item: Item, path: Path) -> Item:
        if name in self.open:
            chain = " -> ".join([*self.open[self.open.index(name) :], name])
            self.problems.add(self.vars[name].where, ("vars", name), f"variables refer to each other: {chain}")
            return broken(item)
        if name not in self.known:
            self.open.append(name)
            self.known[name] = self.expand(self.vars[name], ("vars", name))
            self.open.pop()
        return self.known[name]

    def _typed(self, text: str, via: str, item: Item, path: Path) -> Item:
        # Read like an unquoted scalar; a text field gets the text back (see `text`).
        through = (via,) if via else ()
        if any("\ud800" <= character <= "\udfff" for character in text) or "\0" in text:
            self.problems.add(item.where, path, f"{via} is not valid UTF-8 text")
            return broken(item)
        try:
            return scalar(read_scalar(text) if text else "", item.where, via=through, text=text)
        except ValueError:
            return scalar(text, item.where, via=through, text=text)


def _written(value: object) -> str:
    return {True: "true", False: "false"}[value] if isinstance(value, bool) else str(value)
