"""Reads TOML into checked pydantic models and says what is wrong in one line: file, field, mend."""

import difflib
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from calstation.errors import CalstationError, ConfigurationError
from calstation.messages.catalogue import known
from calstation.messages.rendering import render


class StrictModel(BaseModel):
    """Base of every configuration model: frozen, no unknown keys, no NaN, no silent conversions."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class EntryError(ValueError):
    """A rule over several entries is broken.

    Parameters
    ----------
    code : its entry in the message catalogue
    place : keys and element numbers from where the rule stands to the entry that is wrong
    values : what stands in the braces of the entry's sentences
    """

    def __init__(self, code: str, *place: str | int, **values: Any) -> None:
        super().__init__(code)
        self.code = code if known(code) else ""
        self.place = place
        self.values = values

    def __str__(self) -> str:
        return render(self.code, self.values).line if self.code else str(self.args[0])


@contextmanager
def entry(*place: str | int) -> Iterator[None]:
    """Whatever is found wrong within is told of the entry at `place`."""
    try:
        yield
    except EntryError as exc:
        raise EntryError(exc.code or str(exc), *place, *exc.place, **exc.values) from None
    except ValueError as exc:
        raise EntryError(str(exc), *place) from None


Model = TypeVar("Model", bound=BaseModel)

_BOUNDS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
_KINDS = {
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "list_type": "a list in brackets, [first, second]",
    "dict_type": "a table",
    "model_type": "a table",
    "finite_number": "a finite number",
}


def read_toml(path: Path, error: type[CalstationError] = ConfigurationError) -> dict[str, Any]:
    """Read a TOML file; raises `error` naming the file where it cannot be read or parsed."""
    try:
        with path.open("rb") as stream:
            return tomllib.load(stream)
    except FileNotFoundError as exc:
        raise error(f"{path}: no such file; give the path of an existing TOML file") from exc
    except OSError as exc:
        raise error(f"{path}: cannot be read ({exc.strerror or exc})") from exc
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as exc:
        raise error(f"{path}: not valid TOML: {exc}; correct that line, or give a TOML file") from exc


def validate(
    model: type[Model], data: Any, source: str | Path, error: type[CalstationError] = ConfigurationError
) -> Model:
    """Check `data` against `model`; raises `error` with `source`, the first wrong field and its mend."""
    found = complaints(model, data)
    if found:
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        raise error(f"{source}: {found[0].text}{more}")
    return model.model_validate(data)


@dataclass(frozen=True)
class Complaint:
    """One thing that a model finds wrong.

    Attributes
    ----------
    place : keys and element numbers that lead to the value; () where it is of the whole
    kind : pydantic's, e.g. ``missing`` or ``greater_than``; ``value_error`` for rules of our own
    text : what is wrong, with the mend
    values : what the text is made of: field, value, and the bounds as pydantic calls them
    """

    place: tuple[int | str, ...]
    kind: str
    text: str
    values: Mapping[str, Any]


def complaints(model: type[BaseModel], data: Any) -> list[Complaint]:
    """All that `model` finds wrong with `data`, a misspelt name before the one that is missing for it."""
    try:
        model.model_validate(data)
    except ValidationError as exc:
        details = exc.errors(include_url=False, include_context=True)
        details.sort(key=lambda d: d["type"] != "extra_forbidden")
        return [_complaint(d, data, model) for d in details]
    return []


def _complaint(detail: ErrorDetails, data: Any, model: type[BaseModel]) -> Complaint:
    context = detail.get("ctx", {})
    place = (*detail["loc"], *getattr(context.get("error"), "place", ()))
    text = _sentence({**detail, "loc": place}, data, model)
    values = {"field": _field(place), "value": detail["input"], **context}
    return Complaint(place, detail["type"], text, values)


def load(model: type[Model], path: Path, error: type[CalstationError] = ConfigurationError) -> Model:
    """Read and check a TOML file; raises `error` with one clear line."""
    return validate(model, read_toml(path, error), path, error)


def suggestion(name: str, known: list[str] | tuple[str, ...]) -> str:
    """``; did you mean 'x'?`` for the known name nearest to `name`, or an empty text."""
    near = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean '{near[0]}'?" if near else ""


def _sentence(detail: ErrorDetails, data: Any, model: type[BaseModel]) -> str:
    field = _field(detail["loc"])
    kind = detail["type"]
    context = detail.get("ctx", {})
    value = detail["input"]
    if kind == "missing":
        return f"{field} is missing; add it"
    if kind == "extra_forbidden":
        known = _siblings(data, detail["loc"], model)
        return f"{field} is unknown{suggestion(str(detail['loc'][-1]), known) or '; remove it'}"
    if kind in _BOUNDS:
        key, words = _BOUNDS[kind]
        return f"{field} = {value} is out of range; it must be {words} {context[key]:g}"
    if kind == "literal_error":
        return f"{field} = {value!r} is unknown; it must be {context['expected']}"
    if kind in _KINDS:
        return f"{field} = {value!r} must be {_KINDS[kind]}"
    if kind in ("string_too_short", "too_short") and not value:
        return f"{field} is empty; add what belongs there"
    if kind in ("too_short", "too_long"):
        count = context["min_length" if kind == "too_short" else "max_length"]
        return f"{field} = {value!r} has {len(value)} elements; it must have {count}"
    if kind == "value_error":
        return f"{field + ': ' if field else ''}{context['error']}"
    return f"{field} = {value!r}: {detail['msg']}"


def _field(location: tuple[int | str, ...]) -> str:
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _siblings(data: Any, location: tuple[int | str, ...], model: type[BaseModel]) -> list[str]:
    """Field names that the table at `location` could have held, as far as plain nesting tells."""
    for part in location[:-1]:
        field = model.model_fields.get(str(part))
        inner = getattr(field, "annotation", None)
        for candidate in (inner, *getattr(inner, "__args__", ())):
            if isinstance(candidate, type) and issubclass(candidate, BaseModel):
                model = candidate
                break
    present = data
    for part in location[:-1]:
        present = present.get(part, {}) if isinstance(present, dict) else {}
    taken = present if isinstance(present, dict) else {}
    return [name for name in model.model_fields if name not in taken]
