"""Reading of TOML files into validated pydantic models; errors name file, entry and remedy."""

import difflib
import math
import re
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from calstation.errors import CalstationError, ConfigurationError
from calstation.messages import Text, os_reason, render, sentence
from calstation.messages import entry as catalogue_entry
from calstation.parsing import MAX_TOML, parse_toml, read_limited

#: Keys and element numbers that lead to a value, as in pydantic's ``loc``.
KeyPath = tuple[str | int, ...]

#: Largest magnitude of a number in a file, whose fifth power is still finite.
MAX_MAGNITUDE = 1e60
_TOML_POSITION = re.compile(r"\(at (?:line (\d+), column \d+|end of document)\)")


class StrictModel(BaseModel):
    """Base class of all configuration models: frozen, no unknown keys, no NaN, no silent conversions.

    The validator of a model is built when first used, because a command needs few of the models that it imports.
    """

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


#: A number in a result JSON; a non-finite one is ``null`` there.
Number = Annotated[float, BeforeValidator(lambda value: math.nan if value is None else value)]


class ResultSection(BaseModel):
    """A section of a result JSON. Keys from other versions of the program are kept."""

    model_config = ConfigDict(
        frozen=True, extra="allow", populate_by_name=True, arbitrary_types_allowed=True, defer_build=True
    )


class EntryError(ValueError):
    """An entry of a file violates a rule, given by a code of the message catalogue and the values of its sentences.

    `key_path` is the path (keys and element numbers) to the wrong entry, relative to the location of the check.
    """

    def __init__(self, code: str, *key_path: str | int, **values: Any) -> None:
        super().__init__(code)
        self.code = catalogue_entry(code).code
        self.key_path = key_path
        self.values = values

    def __str__(self) -> str:
        return render(self.code, self.values).line


def check_pattern(pattern: str) -> str:
    """Return the pattern if it is a valid regular expression. Raises EntryError."""
    try:
        re.compile(pattern)
    except re.error as exc:
        position = (exc.pos or 0) + 1
        raise EntryError("entry.not_a_pattern", pattern=pattern, position=position, detail=exc.msg) from None
    return pattern


#: A string that is a regular expression.
Pattern = Annotated[str, AfterValidator(check_pattern)]


@contextmanager
def entry(*key_path: str | int) -> Iterator[None]:
    """Attribute every rule violation inside the block to the entry at `key_path`."""
    try:
        yield
    except EntryError as exc:
        raise EntryError(exc.code, *key_path, *exc.key_path, **exc.values) from None
    except ValueError as exc:
        raise EntryError("entry.other", *key_path, words=str(exc)) from None


Model = TypeVar("Model", bound=BaseModel)

#: Keys of the bounds in pydantic's error context, by error type.
_BOUNDS = {"greater_than": "gt", "greater_than_equal": "ge", "less_than": "lt", "less_than_equal": "le"}
#: Message codes that need only the wrong value and pydantic's error context, by error type.
_CODES = {
    "missing": "entry.missing",
    "literal_error": "entry.not_one_of",
    "string_pattern_mismatch": "entry.misspelt",
}
#: Message codes of the expected type of value, by pydantic's error type.
_TYPES = {
    "float_type": "entry.a_number",
    "int_type": "entry.a_whole_number",
    "string_type": "entry.a_text",
    "bool_type": "entry.true_or_false",
    "list_type": "entry.a_list",
    "dict_type": "entry.a_table",
    "model_type": "entry.a_table",
    "finite_number": "entry.a_finite_number",
}


def read_toml(path: Path, error: type[CalstationError] = ConfigurationError) -> dict[str, Any]:
    """Read a TOML file; raises `error` naming the file if it cannot be read or parsed."""
    return _parsed(_content(path, error), path, error)


def _content(path: Path, error: type[CalstationError] = ConfigurationError) -> bytes:
    try:
        return read_limited(path, MAX_TOML)
    except FileNotFoundError as exc:
        raise error("entry.not_found", file=path) from exc
    except OSError as exc:
        raise error("entry.unreadable", file=path, reason=os_reason(exc)) from exc


def _parsed(content: bytes, path: Path, error: type[CalstationError] = ConfigurationError) -> dict[str, Any]:
    try:
        return parse_toml(content.decode())
    except UnicodeDecodeError as exc:
        line = content.count(b"\n", 0, exc.start) + 1
        raise error("entry.not_toml", file=path, line=line, detail=str(exc)) from exc
    except tomllib.TOMLDecodeError as exc:
        line, detail = toml_error(exc, content.decode())
        raise error("entry.not_toml", file=path, line=line, detail=detail) from exc


def toml_error(error: tomllib.TOMLDecodeError, text: str) -> tuple[int, str]:
    """Return the line number and the description of a TOML error; tomllib gives both only in its message text."""
    position = _TOML_POSITION.search(str(error))
    line = int(position[1]) if position and position[1] else text.count("\n") + 1
    return line, _TOML_POSITION.sub("", str(error)).strip()


def validate(
    model: type[Model], data: Any, source: str | Path, error: type[CalstationError] = ConfigurationError
) -> Model:
    """Validate parsed TOML or JSON with a model; `source` is the file name in messages.

    Raises `error` with the first wrong entry and its remedy.
    """
    if problem := _excessive_number(data):
        raise error("entry.in_file", file=source, what=problem.as_text)
    try:
        return model.model_validate(data)
    except ValidationError as exc:
        first, *more = _problems(exc, data, model)
        if more:
            raise error("entry.in_file_and_more", file=source, what=first.as_text, more=len(more)) from None
        raise error("entry.in_file", file=source, what=first.as_text) from None


def load(model: type[Model], path: Path, error: type[CalstationError] = ConfigurationError) -> Model:
    """Read and validate a TOML file; raises `error` like `read_toml` and `validate`."""
    return validate(model, read_toml(path, error), path, error)


def load_once(model: type[Model], path: Path) -> Model:
    """Read a TOML file like `load`, but validate it again only if its content has changed.

    For models whose checks depend on nothing but the file. The returned model is shared and must not be changed.
    """
    checked: Model = _unchanged(model, path, _content(path))
    return checked


@lru_cache(maxsize=64)
def _unchanged(model: type[BaseModel], path: Path, content: bytes) -> Any:
    return validate(model, _parsed(content, path), path)


@dataclass(frozen=True)
class Problem:
    """One error in the data or text of a file."""

    key_path: KeyPath  #: Path of the entry; () for the whole file.
    #: Pydantic's error type, e.g. ``missing``; ``toml`` for invalid TOML, ``value_error`` for other rules.
    kind: str
    what: Text  #: The message without the name of the entry.
    line: int = 0  #: Line number, counted from 1.
    #: The data of the file; elements of its lists are named after it.
    data: Any = field(default=None, repr=False, compare=False)

    @classmethod
    def of(cls, error: EntryError, *prefix: str | int) -> "Problem":
        """Create the problem of a violated rule; `prefix` is the key path to which its `key_path` is relative."""
        return cls((*prefix, *error.key_path), "value_error", Text(error.code, error.values))

    @property
    def values(self) -> Mapping[str, Any]:
        """Values of the message, and the name of the entry as `field`."""
        return {"field": self.name, **self.what.values}

    @property
    def name(self) -> str:
        """Name of the entry in messages, "" for the whole file."""
        return field_name(self.key_path, self.data)

    @property
    def as_text(self) -> Text:
        """The message, preceded by the name of the entry if there is one."""
        return Text.of("entry.at", field=self.name, what=self.what) if self.name else self.what

    @property
    def text(self) -> str:
        """The message in English, on one line."""
        return sentence(self.as_text)


def _excessive_number(data: Any) -> Problem | None:
    """Return the problem of a number whose powers would overflow, None if there is none."""
    rest: list[tuple[KeyPath, Any]] = [((), data)]
    while rest:
        key_path, value = rest.pop()
        if isinstance(value, dict | list):
            pairs: Iterable[tuple[Any, Any]] = value.items() if isinstance(value, dict) else enumerate(value)
            rest += [((*key_path, key), each) for key, each in pairs if isinstance(each, dict | list | int | float)]
        elif isinstance(value, int | float) and MAX_MAGNITUDE < abs(value) < math.inf:
            what = Text.of("entry.too_large", value=value, limit=MAX_MAGNITUDE)
            return Problem(key_path, "value_error", what, data=data)
    return None


def problems_of(model: type[BaseModel], data: Any) -> list[Problem]:
    """Return all errors of `data` found by `model`, those of unknown names first: a missing name may be misspelt."""
    if problem := _excessive_number(data):
        return [problem]
    try:
        model.model_validate(data)
    except ValidationError as exc:
        return _problems(exc, data, model)
    return []


def _problems(error: ValidationError, data: Any, model: type[BaseModel]) -> list[Problem]:
    details = _best_branches(error.errors(include_url=False, include_context=True), data)
    details.sort(key=lambda d: d["type"] != "extra_forbidden")
    return [_problem(d, data, model) for d in details]


def _best_branches(details: list[ErrorDetails], data: Any) -> list[ErrorDetails]:
    """Keep the errors for the best matching type of each value with several possible types, at their key paths.

    Pydantic reports the errors for each possible type, with the name of the type in the location.
    """
    key_paths: list[KeyPath] = []
    branches: list[tuple[KeyPath, str] | None] = []
    for detail in details:
        keys: list[str | int] = []
        branch, present = None, data
        for part in detail["loc"]:
            absent = isinstance(present, dict) and part not in present and detail["type"] != "missing"
            if isinstance(part, str) and (absent or isinstance(present, list | str | float | int)):
                branch = (tuple(keys), part)
                continue
            keys.append(part)
            present = _element(present, part)
        key_paths.append(tuple(keys))
        branches.append(branch)
    depths: dict[KeyPath, tuple[int, str]] = {}
    for key_path, branch in zip(key_paths, branches, strict=True):
        if branch is not None and len(key_path) > depths.get(branch[0], (0, ""))[0]:
            depths[branch[0]] = (len(key_path), branch[1])
    return [
        {**detail, "loc": key_path}
        for detail, key_path, branch in zip(details, key_paths, branches, strict=True)
        if branch is None or depths[branch[0]][1] == branch[1]
    ]


def _element(data: Any, key: str | int) -> Any:
    """Return an element of a dictionary or list, None if there is none."""
    try:
        return data[key]
    except (KeyError, IndexError, TypeError):
        return None


def value_at(data: Any, key_path: KeyPath) -> Any:
    """Return the value at a key path of dictionaries and lists, None if there is none."""
    for key in key_path:
        data = _element(data, key)
    return data


def field_name(key_path: KeyPath, data: Any = None) -> str:
    """Return the name of an entry as it is written in messages, e.g. ``slots["B"].port`` or ``registers[2].range[1]``.

    An element of a list is identified by its `name` in the data of the file if that is unique, otherwise by its number,
    counted from 1.
    """
    text = ""
    for part in key_path:
        text += f"[{_element_name(data, part)}]" if isinstance(part, int) else f".{part}" if text else part
        data = _element(data, part)
    return text


def _element_name(elements: Any, number: int) -> str:
    names = [_element(element, "name") for element in elements] if isinstance(elements, list) else []
    name = _element(names, number)
    return f'"{name}"' if isinstance(name, str) and names.count(name) == 1 else str(number + 1)


def near_miss(name: str, known: Iterable[str], otherwise: Text | None = None) -> Text:
    """Return the remedy for an unknown name: the most similar known name, or `otherwise` (default: remove it)."""
    names = {other.lower(): other for other in known}
    near = difflib.get_close_matches(name.lower(), list(names), n=1)
    if near:
        return Text.of("entry.did_you_mean", near=names[near[0]])
    return otherwise or Text("entry.remove_it")


def check_names(names: Iterable[str], known: Collection[str], *keys: str) -> None:
    """Raise EntryError if one of the names, which are entries below `keys`, is not a known parameter or group."""
    for name in names:
        if name not in known:
            raise EntryError("entry.unknown_parameter", *keys, name, name=name, remedy=near_miss(name, known))


def _problem(detail: ErrorDetails, data: Any, model: type[BaseModel]) -> Problem:
    error = detail.get("ctx", {}).get("error")
    if isinstance(error, EntryError):
        kind = "missing" if error.code == "entry.missing" else "value_error"
        return replace(Problem.of(error, *detail["loc"]), kind=kind, data=data)
    code, values = _pydantic_message(detail, data, model)
    values = {"value": detail["input"], **detail.get("ctx", {}), **values}
    return Problem(detail["loc"], detail["type"], Text(code, values), data=data)


def _pydantic_message(detail: ErrorDetails, data: Any, model: type[BaseModel]) -> tuple[str, dict[str, Any]]:
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    if kind in _CODES:
        return _CODES[kind], {}
    if kind == "extra_forbidden":
        known = _siblings(data, detail["loc"], model)
        return "entry.unknown", {"remedy": near_miss(str(detail["loc"][-1]), known)}
    if kind in _BOUNDS:
        return f"entry.{kind}", {"bound": context[_BOUNDS[kind]]}
    if kind in _TYPES:
        return "entry.wrong_type", {"wanted": Text(_TYPES[kind])}
    if kind in ("string_too_short", "too_short") and not value:
        return "entry.empty", {}
    if kind in ("too_short", "too_long"):
        needed = context["min_length" if kind == "too_short" else "max_length"]
        return "entry.wrong_length", {"count": len(value), "needed": needed}
    if kind == "value_error":
        return "entry.other", {"words": str(context["error"])}
    return "entry.other", {"words": f"{value!r}: {detail['msg']}"}


def _siblings(data: Any, location: KeyPath, model: type[BaseModel]) -> list[str]:
    """Return the allowed field names that the table at `location` does not contain, through plain nesting only."""
    present = data
    for part in location[:-1]:
        inner = getattr(model.model_fields.get(str(part)), "annotation", None)
        for candidate in (inner, *getattr(inner, "__args__", ())):
            if isinstance(candidate, type) and issubclass(candidate, BaseModel):
                model = candidate
                break
        present = present.get(part, {}) if isinstance(present, dict) else {}
    return [name for name in model.model_fields if not isinstance(present, dict) or name not in present]
