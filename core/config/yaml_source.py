"""Strict YAML: positions kept, traps closed, size bounded.

Events of the C parser are put together here instead of by PyYAML's composer, which recurses without
a bound in C, keeps the last of repeated keys and reads scalars by YAML 1.1. Scalars follow the YAML
1.2 core schema, with only `true` and `false` as booleans.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import yaml

from knotwork.core.config.tree import MAX_DEPTH, MAX_SIZE, Item, Problems, Scalar, container, scalar, short
from knotwork.core.errors import ConfigError

MAX_BYTES = 1 << 20

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_INT = re.compile(r"[-+]?(0|[1-9][0-9]*)\Z")
_BASED = re.compile(r"0x[0-9a-fA-F]+\Z|0o[0-7]+\Z")
_LEADING_ZERO = re.compile(r"[-+]?0[0-9]+\Z")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?\Z")
_INFINITE = re.compile(r"([-+]?)\.(inf|Inf|INF)\Z")
_UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]")

At = Callable[[int, int], str]  # line, column (from 0) to `file:line:column` or the argument


def read_scalar(text: str) -> Scalar:
    """Read an unquoted scalar.

    Raises
    ------
    ValueError
        A number that readers of YAML disagree about, or that does not fit.
    """
    if text in ("", "~", "null", "Null", "NULL"):
        return None
    if text in ("true", "false"):
        return text == "true"
    if _LEADING_ZERO.match(text):
        raise ValueError(f"{short(text)} starts with 0: octal to some readers, decimal to others")
    if _INT.match(text) or _BASED.match(text):
        number = int(text, 0) if len(text) <= 24 else 1 << 64
        if abs(number) >= 1 << 64:
            raise ValueError(f"{short(text)} does not fit into 64 bits")
        return number
    if _FLOAT.match(text):
        real = float(text)
        if real in (float("inf"), float("-inf")):
            raise ValueError(f"{short(text)} is too large for a number; infinity is written .inf")
        return real
    if infinite := _INFINITE.match(text):
        return float(infinite[1] + "inf")
    return float("nan") if text in (".nan", ".NaN", ".NAN") else text


def compose(text: str, at: At, problems: Problems) -> Item | None:
    """Put one YAML document together.

    Parameters
    ----------
    text
        The document.
    at
        Turns a line and a column into what a person is shown.
    problems
        Takes what is wrong and can be survived (a repeated key).

    Returns
    -------
    Item | None
        The document, None if there is nothing in it.

    Raises
    ------
    ConfigError
        Text that is no YAML, too deep or too large.
    """
    if found := _UNPRINTABLE.search(text):
        line, column = (
            text.count("\n", 0, found.start()),
            found.start() - text.rfind("\n", 0, found.start()) - 1,
        )
        message = f"the character U+{ord(found[0]):04X} is not allowed in YAML"
        raise problems.fatal(at(line, column), "", message, "is this a text file?" if found[0] < " " else "")
    composer = _Composer(at, problems)
    try:
        for event in yaml.parse(text, Loader=_LOADER):
            composer.take(event)
    except yaml.MarkedYAMLError as error:
        raise _syntax_error(error, text, at, problems) from None
    except (yaml.YAMLError, UnicodeError) as error:
        raise problems.fatal(at(0, 0), "", f"not valid YAML: {str(error).splitlines()[0]}") from None
    return composer.root


def _syntax_error(error: yaml.MarkedYAMLError, text: str, at: At, problems: Problems) -> ConfigError:
    mark = error.problem_mark or error.context_mark
    line, column = (mark.line, mark.column) if mark else (0, 0)
    lines = text.split("\n")
    bad = lines[line] if line < len(lines) else ""
    if "\t" in bad[: column + 1]:
        column = bad.index("\t")
        return problems.fatal(at(line, column), "", "a tab cannot indent YAML", "use spaces")
    context = f" {error.context}" if error.context and error.context != "while scanning for the next token" else ""
    hint = ""
    if "${" in bad:
        hint = 'inside { } and [ ] a reference needs quotes: "${name}"'
    elif error.context_mark and error.context_mark.line != line and context:
        hint = f"opened at {at(error.context_mark.line, error.context_mark.column)}"
    elif "mapping values" in (error.problem or ""):
        hint = "a text that holds ': ' needs quotes, or the line is indented wrongly"
    return problems.fatal(at(line, column), "", f"not valid YAML: {error.problem}{context}", hint)


@dataclass(slots=True)
class _Open:
    """A list or mapping that is being read."""

    where: str
    anchor: str | None
    values: list[Item] | dict[str, Item]
    size: int = 1
    name: str | None = None  # the key that waits for its value
    key: str = ""  # where that key stands
    use: Literal["keep", "drop", "merge"] = "keep"  # what becomes of that key's value
    is_key: bool = False  # stands where a key should
    merged: list[Item] = field(default_factory=list)  # values of `<<`


class _Composer:
    def __init__(self, at: At, problems: Problems) -> None:
        self.at = at
        self.problems = problems
        self.root: Item | None = None
        self.stack: list[_Open] = []
        self.anchors: dict[str, Item | None] = {}  # None: still open
        self.documents = 0

    def take(self, event: yaml.Event) -> None:
        mark: Any = event.start_mark
        where = self.at(mark.line, mark.column)
        if isinstance(event, yaml.DocumentStartEvent):
            self.documents += 1
            if self.documents > 1:
                raise self.problems.fatal(where, "", "a second document begins here; a file holds one pipeline")
        elif isinstance(event, yaml.CollectionEndEvent):
            self._close(self.stack.pop())
        elif isinstance(event, yaml.AliasEvent):
            self._put(self._alias(str(event.anchor), where), where)
        elif isinstance(event, yaml.NodeEvent):
            self._node(event, where)

    def _node(self, event: Any, where: str) -> None:
        if event.tag is not None:
            tag = str(event.tag).replace("tag:yaml.org,2002:", "!!")
            self.problems.add(where, "", f"the tag {short(tag)} is not allowed", "leave it out")
        if isinstance(event, yaml.ScalarEvent):
            item = self._scalar(event, where)
            if event.anchor:
                self.anchors[event.anchor] = item
            self._put(item, where, merge=event.value == "<<" and event.implicit[0])
            return
        if len(self.stack) >= MAX_DEPTH:
            raise self.problems.fatal(where, "", f"nested deeper than {MAX_DEPTH} levels")
        if event.anchor:
            self.anchors[event.anchor] = None
        top = self.stack[-1] if self.stack else None
        opened: list[Item] | dict[str, Item] = [] if isinstance(event, yaml.SequenceStartEvent) else {}
        is_key = top is not None and isinstance(top.values, dict) and top.name is None
        self.stack.append(_Open(where, event.anchor, opened, is_key=is_key))

    def _scalar(self, event: Any, where: str) -> Item:
        if not event.implicit[0]:
            return scalar(event.value, where)
        try:
            return scalar(read_scalar(event.value), where)
        except ValueError as error:
            self.problems.add(where, "", str(error), f'write "{event.value[:40]}" in quotes if it is a text')
            return replace(scalar(None, where), broken=True)

    def _alias(self, name: str, where: str) -> Item:
        if name not in self.anchors:
            hint = self.problems.nearest(name, self.anchors)
            self.problems.add(where, "", f"no anchor &{name[:60]} stands before this", hint)
        elif (item := self.anchors[name]) is None:
            self.problems.add(where, "", f"the alias *{name[:60]} stands inside its own anchor")
        else:
            return item
        return Item(None, where, broken=True)

    def _close(self, opened: _Open) -> None:
        if isinstance(opened.values, dict):
            for source in opened.merged:
                for name, child in source.mapping().items():
                    opened.values.setdefault(name, child)
        item = container(opened.values, opened.where)
        if opened.anchor:
            self.anchors[opened.anchor] = item
        if opened.is_key:
            self._bad_key(opened.where, "a list or mapping")
        else:
            self._put(item, opened.where)

    def _put(self, item: Item, where: str, merge: bool = False) -> None:
        size = item.size + (self.stack[-1].size if self.stack else 0)
        if size > MAX_SIZE or item.depth + len(self.stack) > MAX_DEPTH:
            message = f"larger than {MAX_SIZE} values or {MAX_DEPTH} levels, aliases counted each time"
            raise self.problems.fatal(where, "", message)
        if not self.stack:
            self.root = item
            return
        top = self.stack[-1]
        top.size = size
        if isinstance(top.values, list):
            top.values.append(item)
        elif top.name is None:
            self._key(top, item, where, merge)
        else:
            if top.use == "merge":
                self._merge(top, item, where)
            elif top.use == "keep":
                top.values[top.name] = replace(item, key=top.key)
            top.name = None

    def _key(self, top: _Open, item: Item, where: str, merge: bool) -> None:
        assert isinstance(top.values, dict)
        if not isinstance(item.value, str):
            if not item.broken:
                self._bad_key(where, short(item.value))
            else:
                top.name, top.use = "", "drop"
            return
        top.name, top.key, top.use = item.value, where, "merge" if merge else "keep"
        if merge:
            return
        if item.value in top.values:
            first = top.values[item.value].key
            self.problems.add(where, "", f"the key {short(item.value)} is repeated", f"first at {first}")
            top.use = "drop"

    def _bad_key(self, where: str, what: str) -> None:
        self.problems.add(where, "", f"a key must be text, this is {what}", "put it in quotes")
        self.stack[-1].name, self.stack[-1].use = "", "drop"

    def _merge(self, top: _Open, item: Item, where: str) -> None:
        sources = item.value if isinstance(item.value, list) else [item]
        for source in sources:
            if isinstance(source.value, dict):
                top.merged.append(source)
            elif not source.broken:
                self.problems.add(where, "", "<< takes a mapping or a list of mappings, usually an alias")
