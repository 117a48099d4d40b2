"""Reads worlds from YAML; every mistake is named with its file, line and column."""

import difflib
import math
from importlib.resources import files
from pathlib import Path

import numpy as np
import yaml

from knotwork.core.errors import InputError
from knotwork.core.messages import F64
from knotwork.core.world.scene import World, box, polyline

_KEYS = (
    "name",
    "about",
    "start",
    "segments",
    "polylines",
    "polygons",
    "boxes",
    "circles",
    "arcs",
    "paths",
)
_SMALLEST = 1e-9  # m; what is smaller cannot be told from a point
_LARGEST = 1e6  # m


def shipped_worlds() -> list[str]:
    """Return the names of the worlds that come with the package."""
    folder = files("knotwork.configs") / "worlds"
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".yaml"))


def load_world(name: str) -> World:
    """Load a shipped world by its name, or any world by the path of its YAML file.

    Raises
    ------
    InputError
        No such world, an unreadable file, or a mistake in it.
    """
    if name.endswith((".yaml", ".yml")) or "/" in name:
        path = Path(name)
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or "not a text file in UTF-8"
            raise InputError(f"cannot read the world: {reason}", where=name) from error
        return parse_world(text, name)
    names = shipped_worlds()
    if name not in names:
        close = difflib.get_close_matches(name, names, n=1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise InputError(
            f"no world {name!r} is shipped", hint=f"{hint}shipped: {', '.join(names)}; or the path of a .yaml"
        )
    resource = files("knotwork.configs") / "worlds" / f"{name}.yaml"
    return parse_world(resource.read_text(encoding="utf-8"), f"{name}.yaml")


def parse_world(text: str, file: str = "<world>") -> World:
    """Build a world from YAML text; `file` is named in errors.

    Keys: `name`, `about`, `start: [x, y, yaw]`, `segments: [[x1, y1, x2, y2], ...]`, `polylines` and
    `polygons` (lists of lists of `[x, y]`; polygons are closed), `boxes: [[x1, y1, x2, y2], ...]`
    (opposite corners), `circles: [[x, y, radius], ...]`, `arcs: [[x, y, radius, first, sweep], ...]`,
    `paths: {name: [[x, y], ...]}`. Metres and radians.

    Raises
    ------
    InputError
        Any mistake, with file:line:column.
    """
    return _Reader(file).world(text)


class _Reader:
    def __init__(self, file: str) -> None:
        self.file = file

    def world(self, text: str) -> World:
        try:
            root = yaml.compose(text, Loader=yaml.SafeLoader)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            where = f"{self.file}:{mark.line + 1}:{mark.column + 1}" if mark else self.file
            raise InputError(f"not YAML: {error.problem or error.context}", where=where) from error
        except (yaml.YAMLError, RecursionError) as error:
            raise InputError(f"not YAML: {error}", where=self.file) from error
        if root is None:
            raise InputError("the world file is empty", where=self.file, hint="expected keys like polygons")
        keys = self.mapping(root, "a world")
        for key, (name, _) in keys.items():
            if key not in _KEYS:
                close = difflib.get_close_matches(key, _KEYS, n=1)
                hint = f"did you mean {close[0]!r}?" if close else f"known keys: {', '.join(_KEYS)}"
                raise self.error(name, f"unknown key {key!r} in a world", hint)
        nodes = {key: value for key, (_, value) in keys.items()}
        segments = self.segments(nodes)
        arcs = self.arcs(nodes)
        if len(segments) + len(arcs) == 0:
            raise self.error(root, "a world needs at least one obstacle", "give polygons, boxes or circles")
        start = self.numbers(nodes["start"], 3, "start: [x, y, yaw]") if "start" in nodes else [0.0] * 3
        return World(
            name=self.text(nodes["name"]) if "name" in nodes else Path(self.file).stem,
            segments=segments,
            arcs=arcs,
            start=(start[0], start[1], start[2]),
            paths=self.paths(nodes),
            about=self.text(nodes["about"]) if "about" in nodes else "",
        )

    def segments(self, nodes: dict[str, yaml.Node]) -> F64:
        parts: list[F64] = []
        for item in self.items(nodes, "segments"):
            x1, y1, x2, y2 = self.numbers(item, 4, "a segment [x1, y1, x2, y2]")
            if math.hypot(x2 - x1, y2 - y1) < _SMALLEST:
                raise self.error(item, "a segment of no length: its two ends are the same point")
            parts.append(np.array([[x1, y1, x2, y2]]))
        for item in self.items(nodes, "boxes"):
            x1, y1, x2, y2 = self.numbers(item, 4, "a box [x1, y1, x2, y2]")
            if min(abs(x2 - x1), abs(y2 - y1)) < _SMALLEST:
                raise self.error(item, "a box of no area: expected two opposite corners")
            parts.append(box(x1, y1, x2, y2))
        for key, closed, least in (("polylines", False, 2), ("polygons", True, 3)):
            for item in self.items(nodes, key):
                parts.append(polyline(self.points(item, f"one of {key}", least, closed), closed))
        return np.vstack(parts) if parts else np.empty((0, 4))

    def arcs(self, nodes: dict[str, yaml.Node]) -> F64:
        rows: list[list[float]] = []
        for item in self.items(nodes, "circles"):
            x, y, radius = self.numbers(item, 3, "a circle [x, y, radius]")
            rows.append([x, y, self.radius(item, radius), 0.0, 2.0 * math.pi])
        for item in self.items(nodes, "arcs"):
            x, y, radius, first, sweep = self.numbers(item, 5, "an arc [x, y, radius, first angle, sweep]")
            if sweep == 0.0 or abs(sweep) > 2.0 * math.pi + 1e-6:
                raise self.error(item, f"the sweep of an arc is {sweep} rad, expected within +-2 pi, not 0")
            rows.append([x, y, self.radius(item, radius), first, sweep])
        return np.array(rows).reshape(-1, 5)

    def paths(self, nodes: dict[str, yaml.Node]) -> dict[str, F64]:
        if "paths" not in nodes:
            return {}
        named = self.mapping(nodes["paths"], "paths")
        return {key: self.points(value, f"path {key!r}", 2, False) for key, (_, value) in named.items()}

    def radius(self, node: yaml.Node, value: float) -> float:
        if value < _SMALLEST:
            raise self.error(node, f"the radius is {value} m, expected more than 0")
        return value

    def points(self, node: yaml.Node, what: str, least: int, closed: bool) -> F64:
        points = [self.numbers(item, 2, f"a point [x, y] of {what}") for item in self.sequence(node, what)]
        if len(points) < least:
            raise self.error(node, f"{what} has {len(points)} points, expected at least {least}")
        for item, before, here in zip(node.value[1:], points, points[1:], strict=False):
            if math.dist(before, here) < _SMALLEST:
                raise self.error(item, f"a point of {what} repeats the one before")
        if closed and math.dist(points[0], points[-1]) < _SMALLEST:
            raise self.error(node.value[-1], f"{what} is closed by itself: leave the repeated first point out")
        return np.array(points)

    def items(self, nodes: dict[str, yaml.Node], key: str) -> list[yaml.Node]:
        return self.sequence(nodes[key], key) if key in nodes else []

    def sequence(self, node: yaml.Node, what: str) -> list[yaml.Node]:
        if not isinstance(node, yaml.SequenceNode):
            raise self.error(node, f"expected a list for {what}")
        return list(node.value)

    def mapping(self, node: yaml.Node, what: str) -> dict[str, tuple[yaml.Node, yaml.Node]]:
        if not isinstance(node, yaml.MappingNode):
            raise self.error(node, f"expected `key: value` lines for {what}")
        out: dict[str, tuple[yaml.Node, yaml.Node]] = {}
        for key, value in node.value:
            text = self.text(key)
            if text in out:
                raise self.error(key, f"key {text!r} is given twice")
            out[text] = (key, value)
        return out

    def numbers(self, node: yaml.Node, count: int, what: str) -> list[float]:
        items = self.sequence(node, what)
        if len(items) != count:
            raise self.error(node, f"expected {what}: {count} numbers, found {len(items)}")
        return [self.number(item) for item in items]

    def number(self, node: yaml.Node) -> float:
        try:
            value = float(self.text(node))
        except ValueError:
            value = math.nan
        if math.isnan(value):
            raise self.error(node, f"{self.text(node)!r} is not a number")
        if abs(value) > _LARGEST:
            raise self.error(node, f"{value} is out of bounds, expected at most {_LARGEST:.0f} m")
        return value

    def text(self, node: yaml.Node) -> str:
        if not isinstance(node, yaml.ScalarNode):
            raise self.error(node, "expected a single value, found a list or a mapping")
        return str(node.value)

    def error(self, node: yaml.Node, message: str, hint: str = "") -> InputError:
        mark = node.start_mark
        return InputError(message, where=f"{self.file}:{mark.line + 1}:{mark.column + 1}", hint=hint)
