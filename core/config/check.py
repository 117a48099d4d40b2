"""A part of the tree validated by a pydantic model: every finding with its place and what was expected."""

import json
from collections.abc import Iterable
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from knotwork.core.config.tree import Item, Path, Problems, is_secret, plain, short

# What an author's own validator may raise beside ValueError and AssertionError.
_FAULTS = (ArithmeticError, AttributeError, LookupError, TypeError)


MAX_ERRORS = 500  # of one model that are looked at

Model = TypeVar("Model", bound=BaseModel)


def check(
    model: type[Model],
    item: Item,
    path: Path,
    problems: Problems,
    *,
    label: str = "",
    also: Iterable[str] = (),
) -> Model | None:
    """Return `item` as an instance of `model`; None after adding what is wrong to `problems`.

    Validation is strict (a text is no number, `on` is no boolean) with JSON's idea of types, so that a
    list becomes a tuple and a text a path. A value from the environment may be text or number.

    Parameters
    ----------
    label
        Whose keys these are ("plugin 'grid'"), for messages.
    also
        Names that are valid beside the model's, for hints.
    """
    try:
        return model.model_validate_json(json.dumps(plain(item)), strict=True)
    except _FAULTS as error:
        problems.add(
            item.position,
            path,
            f"{label or 'the model'} could not check this: {type(error).__name__}: {error}",
        )
        return None
    except ValidationError as error:
        first = error
    details: list[Any] = first.errors(include_url=False)
    places = [_place(item, one) for one in details[:MAX_ERRORS]]
    as_text = frozenset(place for place in places if (at := item.at(place)) and at.text is not None)
    if as_text:
        try:
            return model.model_validate_json(json.dumps(plain(item, as_text)), strict=True)
        except (ValidationError, *_FAULTS) as error:
            if isinstance(error, ValidationError) and error.error_count() < first.error_count():
                details = error.errors(include_url=False)
    problems.more += len(details[MAX_ERRORS:])
    _Explanation(model, item, path, problems, label, frozenset(also)).explain(details[:MAX_ERRORS])
    return None


def _place(item: Item, error: Any) -> Path:
    """Return the path of an error in the tree; pydantic puts names of union members between."""
    place: list[str | int] = []
    current: Item | None = item
    location = error["loc"]
    for index, part in enumerate(location):
        child = current.child(part) if current is not None else None
        if child is not None or (error["type"] == "missing" and index == len(location) - 1):
            place.append(part)
            current = child
    return tuple(place)


class _Explanation:
    def __init__(
        self,
        model: type[BaseModel],
        item: Item,
        path: Path,
        problems: Problems,
        label: str,
        also: frozenset[str],
    ) -> None:
        self.model = model
        self.item = item
        self.path = path
        self.problems = problems
        self.label = label
        self.also = also

    def explain(self, errors: list[Any]) -> None:
        places: dict[Path, list[Any]] = {}
        for error in errors:
            places.setdefault(_place(self.item, error), []).append(error)
        for place, found in places.items():
            at = self.item.nearest(place)
            inside = () if found[0]["type"] in ("missing", "extra_forbidden") else at.walk()
            if not at.broken and not any(child.broken for _, child in inside):
                self._one(place, found, at)

    def _one(self, place: Path, errors: list[Any], at: Item) -> None:
        kind = errors[0]["type"]
        path = (*self.path, *place)
        if kind == "missing":
            field = _field(self.model, place)
            message = f"missing, expected {self._meaning(field)}" if field else "missing"
            self.problems.add(at.position, path, message)
        elif kind == "extra_forbidden":
            fields = {name for model in _models_at(self.model, place[:-1]) for name in _keys(model)}
            whose = f" of {self.label}" if self.label else ""
            names = fields | self.also if len(place) == 1 else fields
            hint = self.problems.nearest(place[-1], names) or "it takes no keys"
            self.problems.add(at.key or at.where, path, f"unknown key{whose}", hint)
        else:
            expected, *others = dict.fromkeys(_expected(one) for one in errors)
            expected = " or ".join([expected, *(one.removeprefix("expected ") for one in others)])
            unit = _unit(self.model, place)
            secret = any(is_secret(part) for part in (*path, *at.via))
            own_words = kind in ("value_error", "assertion_error")
            got = "" if own_words else f", got {'***' if secret else short(plain(at))}"
            self.problems.add(at.position, path, f"{expected}{unit}{got}", self._hint(errors, at, unit))

    def _meaning(self, field: FieldInfo) -> str:
        extra = field.json_schema_extra
        unit = f" [{extra['unit']}]" if isinstance(extra, dict) and "unit" in extra else ""
        return (field.description or "a value") + unit

    def _hint(self, errors: list[Any], at: Item, unit: str) -> str:
        kind = errors[0]["type"]
        if kind == "literal_error" and isinstance(at.value, str):
            words = [word.strip("' ") for one in errors for word in _words(one)]
            hint = self.problems.nearest(at.value, words)
            return hint if hint.startswith("did you mean") else ""
        if kind == "bool_type" and at.value in (
            "on",
            "off",
            "yes",
            "no",
            "True",
            "False",
            "TRUE",
            "FALSE",
            0,
            1,
        ):
            return f"write {'true' if str(at.value).lower() in ('on', 'yes', 'true', '1') else 'false'}"
        if kind == "string_type" and isinstance(at.value, int | float):
            return "put it in quotes"
        if kind in ("float_type", "int_type") and isinstance(at.value, str) and at.value[:1].isdigit():
            return f"write the number alone{f', in{unit}' if unit else ''}"
        return ""


def _words(error: Any) -> list[str]:
    return str(error.get("ctx", {}).get("expected", "")).replace(" or ", ", ").split(", ")


_WORDS = {
    "float_type": "expected a number",
    "int_type": "expected a whole number",
    "int_from_float": "expected a whole number",
    "bool_type": "expected true or false",
    "string_type": "expected a text",
    "list_type": "expected a list",
    "tuple_type": "expected a list",
    "dict_type": "expected a mapping",
    "model_type": "expected a mapping",
    "finite_number": "expected a finite number",
    "greater_than": "expected a number > {gt:g}",
    "greater_than_equal": "expected a number >= {ge:g}",
    "less_than": "expected a number < {lt:g}",
    "less_than_equal": "expected a number <= {le:g}",
}


def _expected(error: Any) -> str:
    if template := _WORDS.get(error["type"]):
        return template.format(**error.get("ctx", {}))
    text = str(error["msg"]).removeprefix("Value error, ").removeprefix("Assertion failed, ")
    for start in ("Input should be ", "String should ", "Input should "):
        if text.startswith(start):
            return ("expected a text that should " if start[0] == "S" else "expected ") + text[len(start) :]
    return text[:1].lower() + text[1:]


def _unit(model: type[BaseModel], place: Path) -> str:
    field = _field(model, place)
    extra = field.json_schema_extra if field else None
    unit = extra.get("unit") if isinstance(extra, dict) else None
    return f" [{unit}]" if unit and unit != "1" else ""


def _field(model: type[BaseModel], place: Path) -> FieldInfo | None:
    """Return the innermost field on the way to a place."""
    found: FieldInfo | None = None
    models = [model]
    for part in place:
        fields = [field for one in models if (field := _keys(one).get(str(part)))]
        if fields:
            found = fields[0]
            models = [inner for field in fields for inner in _inner(field.annotation)]
    return found


def _models_at(model: type[BaseModel], place: Path) -> list[type[BaseModel]]:
    models = [model]
    for part in place:
        if isinstance(part, int):
            continue
        fields = [field for one in models if (field := _keys(one).get(part))]
        if fields:
            models = [inner for field in fields for inner in _inner(field.annotation)]
    return models


def _keys(model: type[BaseModel]) -> dict[str, FieldInfo]:
    return {field.alias or name: field for name, field in model.model_fields.items()}


def _inner(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and get_origin(annotation) is None:
        return [annotation] if issubclass(annotation, BaseModel) else []
    if get_origin(annotation) is not None or isinstance(annotation, UnionType | type(Union)):
        return [model for one in get_args(annotation) for model in _inner(one)]
    return []
