"""Plain data written as YAML that the strict loader reads back, and a pipeline shown with its origins."""

import json
import re
from collections.abc import Mapping
from typing import Any

from knotwork.core.config.model import Origin, Pipeline
from knotwork.core.config.tree import Path, dotted, is_secret, one_line
from knotwork.core.config.yaml_source import read_scalar

MASK = "***"
_BARE = re.compile(r"[A-Za-z_/.][A-Za-z0-9_/.+-]*( [A-Za-z0-9_/.+()-]+)*\Z")
_SPECIAL = re.compile("[\x7f-\x9f\u2028\u2029\ufeff\ufffe\uffff]")
_OLD_BOOLEANS = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")


def dump(data: Mapping[str, Any], comments: Mapping[str, str] | None = None) -> str:
    """Write plain data as YAML.

    Parameters
    ----------
    data
        Mappings with text keys, lists and scalars (`Pipeline.resolved`).
    comments
        Comment of a line by dotted key path; comments are aligned.
    """
    lines = _Writer(comments or {}).mapping(data, (), 0)
    width = min(max((len(text) for text, comment in lines if comment), default=0), 60)
    return "".join(f"{text.ljust(width)}  # {comment}\n" if comment else f"{text}\n" for text, comment in lines)


def show(pipeline: Pipeline, origin: bool = False) -> str:
    """Return the resolved pipeline as YAML, secrets masked.

    Parameters
    ----------
    origin
        Say behind each value where it came from: `file:line:column`, the argument, `via` the
        variables and environment variables it went through, or whose default it is.
    """
    masked = mask(pipeline.resolved, pipeline.origins)
    if not origin:
        return dump(masked)
    return dump(masked, {key: one_line(str(origin)) for key, origin in pipeline.origins.items()})


def mask(data: Any, origins: Mapping[str, Origin] | None = None, path: Path = ()) -> Any:
    """Return plain data with the values of secret keys (token, password) replaced by `***`.

    With `origins`, what came through a secret variable or environment variable is masked as well.
    """
    via = origins[dotted(path)].via if origins and dotted(path) in origins else ()
    if path and data not in (None, "") and (is_secret(path[-1]) or any(is_secret(one) for one in via)):
        return MASK
    if isinstance(data, dict):
        return {name: mask(child, origins, (*path, name)) for name, child in data.items()}
    if isinstance(data, list):
        return [mask(child, origins, (*path, index)) for index, child in enumerate(data)]
    return data


class _Writer:
    def __init__(self, comments: Mapping[str, str]) -> None:
        self.comments = comments

    def mapping(self, data: Mapping[str, Any], path: Path, indent: int) -> list[tuple[str, str]]:
        lines: list[tuple[str, str]] = []
        for name, value in data.items():
            lines += self.entry(f"{' ' * indent}{written(str(name))}:", value, (*path, name), indent + 2)
        return lines

    def entry(self, head: str, value: Any, path: Path, indent: int) -> list[tuple[str, str]]:
        """Return the lines of one value behind `head`, each with its comment."""
        if isinstance(value, Mapping) and value:
            return [(head, ""), *self.mapping(value, path, indent)]
        if isinstance(value, list) and value and not self.on_one_line(value, path):
            lines = [(head, "")]
            for index, element in enumerate(value):
                inner = self.entry(f"{' ' * indent}-", element, (*path, index), indent + 2)
                if isinstance(element, Mapping) and element:  # "- key: value" on the line of the dash
                    first, comment = inner[1]
                    inner = [(f"{' ' * indent}- {first.strip()}", comment), *inner[2:]]
                lines += inner
            return lines
        return [(f"{head} {written(value)}", self.comments.get(dotted(path), ""))]

    def on_one_line(self, value: list[Any], path: Path) -> bool:
        if any(isinstance(element, Mapping | list) and element for element in value):
            return False
        if len(value) > 16 or sum(len(written(element)) + 2 for element in value) > 70:
            return False
        own = _source(self.comments.get(dotted(path), ""))
        return all(_source(self.comments.get(dotted((*path, index)), own)) == own for index in range(len(value)))


def _source(comment: str) -> str:
    """Return a comment without line and column: elements of one list in one file share a line."""
    return re.sub(r":\d+:\d+(?= via |\Z)", "", comment)


def written(value: Any) -> str:
    """Return a scalar, or a list of scalars, as YAML on one line."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(written(element) for element in value)}]"
    if isinstance(value, Mapping):
        return "{}"
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return _real(value)
    return _text(value) if isinstance(value, str) else str(value)


def _real(value: float) -> str:
    text = repr(value)
    if "e" in text and "." not in text:
        return text.replace("e", ".0e")  # older readers take 1e-05 for a text
    return {"inf": ".inf", "-inf": "-.inf", "nan": ".nan"}.get(text, text)


def _text(value: str) -> str:
    if _BARE.match(value) and value.lower() not in _OLD_BOOLEANS:
        try:
            if read_scalar(value) == value:
                return value
        except ValueError:
            pass
    return _SPECIAL.sub(lambda found: f"\\u{ord(found[0]):04x}", json.dumps(value, ensure_ascii=False))
