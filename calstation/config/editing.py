"""Editing of a site's files: lists files, checks texts, and changes values without losing comments."""

import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

import tomlkit
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from tomlkit.container import OutOfOrderTableProxy
from tomlkit.items import AoT, InlineTable, Table

from calstation.config import library
from calstation.config.blocks import add_table, add_value, has_table, nested, remove_table
from calstation.config.product import (
    ProductConfig,
    missing_files,
    register_conflicts,
    schedule_values,
    unjudged_limits,
    unknown_targets,
)
from calstation.config.slots import STATION_ENTRIES
from calstation.config.station import BenchSettings, StationConfig, load_bench
from calstation.devices.profiles import ChamberProfile, FrameSection, ImuProfile, TableProfile, load_imu_profile
from calstation.errors import ConfigurationError
from calstation.messages import Text, os_reason
from calstation.parsing import MAX_TOML, parse_toml, read_limited
from calstation.physics import NAMES, entry_of, parameter_indices
from calstation.schema import KeyPath, Problem, problems_of, read_toml, toml_error
from procedures import method

#: Model of each kind of file.
MODELS: dict[str, type[BaseModel]] = {
    "stations": StationConfig,
    "tables": TableProfile,
    "chambers": ChamberProfile,
    "imus": ImuProfile,
    "products": ProductConfig,
}

#: Patterns of lines that occur in only one kind of file.
_SIGNATURES = {
    "stations": (r"\[site\]",),
    "imus": (r"\[frame\]", r"\[stream\]", r"\[noise\]"),
    "products": (r"serial_pattern\s*=", r"\[limits"),
    "chambers": (r"max_rate_c_per_min\s*=",),
    "tables": (r"\[outer\]", r"\[inner\]", r"\[modbus\]", r"\[text\]", r"outer_axis\s*="),
}

#: Private-use character that no file contains, inserted temporarily to find a line.
_MARKER = "\ue000"

#: A unit such as ``m/s/√s``.
_UNIT = r"(?:√?[µmk]?(?:rad|deg|°C?|ppm|Hz|min|m|s|g|h|K|%)[²³]?)(?:[/·]√?[µmk]?(?:rad|°|Hz|min|m|s|g|h|K)[²³]?)*"
_NUMBER = r"\d+(?:\.\d+)?(?:[eE][+−-]?\d+)?"
#: A number or a formula such as ``0.1/(3600 · 256)``.
_AMOUNT = rf"\(?{_NUMBER}(?:\)?\s*[/·×*^]\s*\(?[+−-]?{_NUMBER})*\)?"
#: Comments with nothing but the value in another unit or as a formula: the unit first, or an SI unit at the end.
_CONVERSIONS = (
    re.compile(rf"#\s*({_UNIT})[,;:]\s+[±+−-]?\s?{_AMOUNT}\s*{_UNIT}\s*"),
    re.compile(rf"#\s*(1)[,;:]\s+[±+−-]?\s?{_AMOUNT}\s*(?:ppm|%)\s*"),
    re.compile(rf"#\s*{_AMOUNT}\s+((?:rad|m|s|Hz|K)(?:[/·]√?(?:s|m|Hz)²?)*)\s*"),
)

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


@dataclass(frozen=True)
class ConfigFile:
    """A configuration file; `shipped` is True if it is a default that the site has not replaced."""

    name: str
    path: Path
    shipped: bool


def list_files(kind: str) -> list[ConfigFile]:
    """Return all files of a kind in alphabetical order; a site's file hides the shipped file with the same name."""
    files = [(name, library.find(kind, name)) for name in library.names(kind)]
    return [ConfigFile(name, path, path.is_relative_to(library.shipped_folder())) for name, path in files]


def detect_kind(path: Path, text: str) -> str:
    """Determine the kind of a file from its folder, or else from its tables. Raises ConfigurationError."""
    folder = path.absolute().parent.name
    if folder in MODELS:
        return folder
    for kind, patterns in _SIGNATURES.items():
        if any(re.search(rf"^\s*{pattern}", text, re.MULTILINE) for pattern in patterns):
            return kind
    raise ConfigurationError("configuration.unknown_kind", file=path, kinds=list(MODELS))


def check(kind: str, text: str, path: Path | None = None) -> list[Problem]:
    """Return all errors due to which a file at `path` with this text could not be loaded; [] if it may be saved.

    Parameters
    ----------
    kind : kind of the file
    text : text to check
    path : path of the file, which determines the files that it names; None for a new file
    """
    try:
        data = parse_toml(text)
    except tomllib.TOMLDecodeError as exc:
        line, detail = toml_error(exc, text)
        return [Problem((), "toml", Text.of("configuration.not_toml", detail=detail), line)]
    problems = check_data(kind, data, path)
    return [replace(problem, line=line_of(text, problem.key_path), data=data) for problem in problems]


def warnings(kind: str, text: str) -> list[Problem]:
    """Return warnings about probable mistakes in a valid text of a product.

    These are limits that no stage of the product can judge, limits of a value that are narrower than the limit of its
    sigma, and target sigmas above the limit of the sigma.
    """
    if kind != "products":
        return []
    data = parse_toml(text)
    product = ProductConfig.model_validate(data)
    texts = [*_unjudged_limits(product), *_limits_below_sigma(product), *_targets_above_limit(product)]
    return [Problem(key_path, "warning", what, line_of(text, key_path), data) for key_path, what in texts]


def _unjudged_limits(product: ProductConfig) -> Iterator[tuple[KeyPath, Text]]:
    with suppress(ConfigurationError):  # the error is shown for the profile's own file
        for name in unjudged_limits(product, load_imu_profile(library.find("imus", product.imu))):
            yield ("limits", name), Text.of("limits.no_stage", parameter=name, stages=product.stages)


def _limits_below_sigma(product: ProductConfig) -> Iterator[tuple[KeyPath, Text]]:
    for name, limit in product.limits.items():
        if limit.interval is None or limit.sigma_below is None:
            continue
        half = (limit.interval[1] - limit.interval[0]) / 2.0
        if half < limit.sigma_below:
            what = Text.of("limits.narrower_than_sigma", half=half, sigma=limit.sigma_below)
            yield ("limits", name, "within"), what


def _targets_above_limit(product: ProductConfig) -> Iterator[tuple[KeyPath, Text]]:
    for target, sigma in product.targets.items():
        entries = [entry_of(product.limits, NAMES[i]) for i in parameter_indices(target)]
        smallest = min((e.sigma_below for e in entries if e is not None and e.sigma_below is not None), default=sigma)
        if sigma > smallest * (1.0 + 1e-9):
            yield ("targets", target), Text.of("limits.target_above_sigma", target=sigma, sigma=smallest)


def check_data(kind: str, data: Mapping[str, Any], path: Path | None = None) -> list[Problem]:
    """Return all errors in the data of the file at `path`, without line numbers."""
    model = MODELS[kind]
    problems = problems_of(model, data)
    if problems:
        return problems
    checked = model.model_validate(data)
    if isinstance(checked, StationConfig):
        return _check_station(checked)
    return _check_product(checked, path) if isinstance(checked, ProductConfig) else []


def _check_station(station: StationConfig) -> list[Problem]:
    problems = list(_unknown_profile("tables", station.table.profile, "table", "profile"))
    if station.chamber is not None:
        problems += _unknown_profile("chambers", station.chamber.profile, "chamber", "profile")
    if station.bench is not None:
        bench: BenchSettings = load_bench()
        settings = {name: value for name, value in station.bench.items() if name not in STATION_ENTRIES}
        problems += _problems_at(("bench",), bench.model, settings)
    if station.product is not None:
        problems += _unknown_profile("products", station.product, "product")
    for number, slot in enumerate(station.slots):
        for kind, name in (("imus", slot.imu), ("products", slot.product)):
            problems += () if name is None else _unknown_profile(kind, name, "slots", number, kind.removesuffix("s"))
    return problems


def _check_product(product: ProductConfig, path: Path | None) -> list[Problem]:
    problems = list(_unknown_profile("imus", product.imu, "imu"))
    if not product.limits:
        problems.append(Problem((), "missing", Text("product.no_limits")))
    if not problems:
        with suppress(ConfigurationError):  # the error is shown for the profile's own file
            profile = load_imu_profile(library.find("imus", product.imu))
            problems += map(Problem.of, register_conflicts(product, profile))
    problems += map(Problem.of, unknown_targets(product.targets, "targets"))
    problems += map(Problem.of, missing_files(product, path))
    for stage in dict.fromkeys((*product.stages, *product.schedule)):
        key_path: KeyPath = ("schedule", stage) if stage in product.schedule else ("stages",)
        try:
            stage_method = method(stage)
        except ConfigurationError as exc:
            problems.append(Problem(key_path, "value_error", exc.as_text))
            continue
        values = schedule_values(product, stage, {})
        problems += _problems_at(key_path, stage_method.schedule, values)
        targets = values.get("targets")
        if stage in product.schedule and isinstance(targets, dict) and targets != product.targets:
            problems += map(Problem.of, unknown_targets(targets, "schedule", stage, "targets"))
    return problems


def _problems_at(key_path: KeyPath, model: type[BaseModel], data: Any) -> list[Problem]:
    return [replace(problem, key_path=(*key_path, *problem.key_path)) for problem in problems_of(model, data)]


def _unknown_profile(kind: str, name: str, *key_path: str | int) -> Iterator[Problem]:
    known = library.names(kind)
    if name not in known:
        yield Problem(key_path, "no_profile", Text.of("configuration.no_profile", kind=kind, name=name, known=known))


def field_of(kind: str, key_path: KeyPath) -> FieldInfo | None:
    """Return the model field of an entry of a file, or None if the entry has no model field."""
    annotation: Any = MODELS[kind]
    field = None
    for key in key_path:
        annotation, _ = required_type(annotation)
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            field = annotation.model_fields[str(key)]
            annotation = field.annotation
        elif get_origin(annotation) in (list, dict):
            field, annotation = None, get_args(annotation)[-1]
        else:
            return None
    return field


def required_type(annotation: Any) -> tuple[Any, bool]:
    """Return the type of a value, which is the first type of a union, and whether the value is optional."""
    if get_origin(annotation) not in (Union, UnionType):
        return annotation, False
    options = get_args(annotation)
    return next(option for option in options if option is not NoneType), NoneType in options


def line_of(text: str, keys: KeyPath) -> int:
    """Return the line (from 1) of the value at `keys` in a valid TOML text, or else of its innermost table."""
    document = tomlkit.parse(text)
    item: Any = document
    parent: Any = None
    last: str | int = ""
    for key in keys:
        try:
            child = item[key]
        except (KeyError, IndexError, TypeError):
            break
        parent, last, item = item, key, child
    if parent is None:
        return 1
    while isinstance(item, AoT | OutOfOrderTableProxy) or (isinstance(item, Table) and item.is_super_table()):
        parent, last = item, 0 if isinstance(item, AoT) else next(iter(item))
        item = parent[last]
    if isinstance(item, Table):
        item.comment(_MARKER)  # the comment is on the line of the header
    else:
        parent[last] = _MARKER
    return tomlkit.dumps(document).partition(_MARKER)[0].count("\n") + 1


def edit_toml(text: str, changes: Mapping[KeyPath, Any]) -> str:
    """Change some values of a text and leave everything else, including comments, unchanged.

    A comment that only repeats a changed value in another unit is reduced to that unit.

    `changes` contains new values by entry; None removes the value, and its table if it becomes empty.
    """
    for key_path, value in changes.items():
        text = _remove_value(text, key_path) if value is None else _set_value(text, key_path, value)
    return text


def _set_value(text: str, key_path: KeyPath, value: Any) -> str:
    """Set a value; a new table with one or two keys gets a header unless it is inside a list or an inline table."""
    document = tomlkit.parse(text)
    table: Any = document
    inline = False
    for depth, key in enumerate(key_path[:-1]):
        inline = inline or depth > 1 or isinstance(key, int) or isinstance(table, InlineTable)
        if isinstance(key, str) and key not in table:
            if inline:
                return _set_value(text, key_path[: depth + 1], nested(key_path[depth + 1 :], value))
            return add_table(text, key_path[:-1], {str(key_path[-1]): value})
        table = table[key]
    key = key_path[-1]
    if isinstance(key, str) and key not in table:
        if isinstance(value, dict) and len(key_path) < 3 and not (inline or isinstance(table, InlineTable)):
            return add_table(text, key_path, value)
        if isinstance(value, dict):
            members, value = value, tomlkit.inline_table()
            value.update(members)
        if has_table(text, key_path[:-1]):
            return add_value(text, key_path[:-1], key, value)
    before = table[key] if isinstance(key, str) and key in table else value
    table[key] = value
    if before != value:
        trivia = tomlkit.items.item(table[key]).trivia
        for conversion in _CONVERSIONS:
            if match := conversion.fullmatch(trivia.comment):
                trivia.comment = f"# {match[1]}"
    return tomlkit.dumps(document)


def _remove_value(text: str, key_path: KeyPath) -> str:
    """Remove a value, and its table if that becomes empty; a text without the value remains unchanged."""
    document = tomlkit.parse(text)
    owner: Any = document
    for key in key_path[:-1]:
        if isinstance(key, str) and key not in owner:
            return text
        owner = owner[key]
    if key_path[-1] not in owner:
        return text
    if has_table(text, key_path):
        text = remove_table(text, key_path)
    else:
        del owner[key_path[-1]]
        text = tomlkit.dumps(document)
    if len(key_path) > 1 and isinstance(key_path[-2], str) and not owner:
        return _remove_value(text, key_path[:-1])
    return text


def is_name(name: str) -> bool:
    """Return whether a name is valid for a file."""
    return _NAME.fullmatch(name) is not None


def new_name(kind: str, name: str) -> str:
    """Return `name` if it is valid for a new file. Raises ConfigurationError if it is invalid or exists."""
    if not is_name(name):
        raise ConfigurationError("configuration.bad_name", name=name)
    if name in library.names(kind):
        raise ConfigurationError("configuration.name_taken", name=name)
    return name


def read_text(path: Path) -> str:
    """Read a file. Raises ConfigurationError."""
    try:
        return read_limited(path, MAX_TOML).decode().replace("\r\n", "\n")
    except (OSError, UnicodeDecodeError) as exc:
        reason = os_reason(exc) if isinstance(exc, OSError) else Text.of("configuration.not_utf8")
        raise ConfigurationError("configuration.unreadable", file=path, reason=reason) from exc


def is_bench(path: Path) -> bool:
    """Return whether a station file describes a virtual bench; False if it cannot be read."""
    try:
        return "bench" in read_toml(path)
    except ConfigurationError:
        return False


def frame_size(frame: Mapping[str, Any]) -> tuple[int, bool] | None:
    """Return the size in bytes of a `[frame]` with all fields, and whether it is fixed; None if it is invalid."""
    try:
        section = FrameSection.model_validate(frame)
    except ValidationError:
        return None
    return section.min_size(), section.format == "binary" and section.length is None
