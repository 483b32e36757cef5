"""Editing of a site's files: lists them, checks a text during editing, and changes values without losing comments."""

import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomlkit
from pydantic import BaseModel, ValidationError
from tomlkit.container import OutOfOrderTableProxy
from tomlkit.items import AbstractTable, AoT, Table

from calstation.config import library
from calstation.config.station import (
    ProductConfig,
    StationConfig,
    missing_files,
    register_conflicts,
    schedule_values,
    unknown_targets,
)
from calstation.devices.profiles import FrameSection, ImuProfile, TableProfile, load_imu_profile
from calstation.errors import ConfigurationError
from calstation.messages import Text, os_reason
from calstation.schema import KeyPath, Problem, problems_of, read_toml, toml_error
from procedures import method

#: Model of each kind of file.
MODELS: dict[str, type[BaseModel]] = {
    "stations": StationConfig,
    "tables": TableProfile,
    "imus": ImuProfile,
    "products": ProductConfig,
}

#: Patterns of lines that occur only in files of one kind.
_SIGNATURES = {
    "stations": (r"\[site\]",),
    "imus": (r"\[frame\]", r"\[stream\]", r"\[noise\]"),
    "products": (r"serial_pattern\s*=", r"\[limits"),
    "tables": (r"\[outer\]", r"\[inner\]", r"\[modbus\]", r"\[text\]", r"outer_axis\s*="),
}

#: Temporary value used to find a line: a private-use character that no file contains.
_MARKER = "\ue000"

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


@dataclass(frozen=True)
class ConfigFile:
    """A configuration file; `shipped` is True for a default that the site has not replaced."""

    name: str
    path: Path
    shipped: bool


def list_files(kind: str) -> list[ConfigFile]:
    """Return all files of a kind, sorted; a site's file hides the shipped one with the same name."""
    files, shipped = {name: library.find(kind, name) for name in library.names(kind)}, library.shipped_folder()
    return [ConfigFile(name, path, path.is_relative_to(shipped)) for name, path in files.items()]


def detect_kind(path: Path, text: str) -> str:
    """Return the kind of a file from its folder or, failing that, its tables. Raises ConfigurationError if unknown."""
    folder = path.absolute().parent.name
    if folder in MODELS:
        return folder
    for kind, patterns in _SIGNATURES.items():
        if any(re.search(rf"^\s*{pattern}", text, re.MULTILINE) for pattern in patterns):
            return kind
    raise ConfigurationError("configuration.unknown_kind", file=path, kinds=list(MODELS))


def check(kind: str, text: str, path: Path | None = None) -> list[Problem]:
    """Return all errors in the text of the file at `path`, by the same rules as for loading; [] if it may be saved."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as exc:
        line, detail = toml_error(exc, text)
        return [Problem((), "toml", Text.of("configuration.not_toml", detail=detail), line)]
    return [replace(problem, line=line_of(text, problem.place)) for problem in check_data(kind, data, path)]


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
    if station.bench is not None:
        from calstation.bench import BenchConfig

        problems += _problems_at(("bench",), BenchConfig, station.bench)
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
        place: KeyPath = ("schedule", stage) if stage in product.schedule else ("stages",)
        try:
            chosen = method(stage)
        except ConfigurationError as exc:
            problems.append(Problem(place, "value_error", exc.as_text))
            continue
        values = schedule_values(product, stage, {})
        problems += _problems_at(place, chosen.schedule, values)
        targets = values.get("targets")
        if stage in product.schedule and isinstance(targets, dict) and targets != product.targets:
            problems += map(Problem.of, unknown_targets(targets, "schedule", stage, "targets"))
    return problems


def _problems_at(place: KeyPath, model: type[BaseModel], data: Any) -> list[Problem]:
    return [replace(problem, place=(*place, *problem.place)) for problem in problems_of(model, data)]


def _unknown_profile(kind: str, name: str, *place: str) -> Iterator[Problem]:
    known = library.names(kind)
    if name not in known:
        yield Problem(place, "no_profile", Text.of("configuration.no_profile", kind=kind, name=name, known=known))


def line_of(text: str, keys: KeyPath) -> int:
    """Return the line (from 1) of the value at `keys` in a valid TOML text, or of the innermost table for it."""
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
        item.comment(_MARKER)  # is on the line of the table's header
    else:
        parent[last] = _MARKER
    return tomlkit.dumps(document).partition(_MARKER)[0].count("\n") + 1


def edit_toml(text: str, changes: Mapping[KeyPath, Any]) -> str:
    """Change some values of a text and leave everything else, including comments, unchanged.

    `changes` contains new values by entry; None removes the value, and its table if it becomes empty.
    """
    document = tomlkit.parse(text)
    added = []
    for place, value in changes.items():
        if value is None:
            _remove(document, place)
            continue
        table: Any = document
        for key in place[:-1]:
            if key not in table:
                table[key] = tomlkit.table()
                added.append(table[key])
            table = table[key]
        table[place[-1]] = value
    for table in added:
        table.add(tomlkit.nl())
    return tomlkit.dumps(document)


def _remove(table: Any, place: KeyPath) -> None:
    key, rest = place[0], place[1:]
    if key not in table:
        return
    if not rest:
        del table[key]
        return
    _remove(table[key], rest)
    if isinstance(table[key], AbstractTable) and not table[key]:
        del table[key]


def is_name(name: str) -> bool:
    """Whether the name is valid for a file."""
    return _NAME.fullmatch(name) is not None


def new_name(kind: str, name: str) -> str:
    """Check a name for a new file. Raises ConfigurationError if it is invalid or taken."""
    if not is_name(name):
        raise ConfigurationError("configuration.bad_name", name=name)
    if name in library.names(kind):
        raise ConfigurationError("configuration.name_taken", name=name)
    return name


def read_text(path: Path) -> str:
    """Read a file. Raises ConfigurationError."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as exc:
        reason = os_reason(exc) if isinstance(exc, OSError) else Text.of("configuration.not_utf8")
        raise ConfigurationError("configuration.unreadable", file=path, reason=reason) from exc


def is_bench(path: Path) -> bool:
    """Whether a station file describes a virtual bench; False if it cannot be read."""
    try:
        return "bench" in read_toml(path)
    except ConfigurationError:
        return False


def frame_size(frame: Mapping[str, Any]) -> tuple[int, bool] | None:
    """Return the size of a `[frame]` with all its fields, bytes, and whether it is fixed; None if it is invalid."""
    try:
        section = FrameSection.model_validate(frame)
    except ValidationError:
        return None
    return section.min_size(), section.format == "binary" and section.length is None
