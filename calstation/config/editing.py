"""The files that a site edits: listed, checked as typed, changed without losing their comments."""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomlkit
from pydantic import BaseModel, ValidationError
from tomlkit.container import OutOfOrderTableProxy
from tomlkit.items import AbstractTable, AoT, Table

from calstation.config import library
from calstation.config.register_limits import check_register_limits
from calstation.config.station import ProductConfig, StationConfig, schedule_values
from calstation.devices.profiles.frame import FrameSection
from calstation.devices.profiles.imu import ImuProfile, load_imu_profile
from calstation.devices.profiles.table import TableProfile
from calstation.errors import ConfigurationError
from calstation.schema import complaints, read_toml
from calstation.sequencer.stop_rule import named
from procedures import method

#: Keys and element numbers that lead to a value, as in pydantic's ``loc``.
KeyPath = tuple[str | int, ...]

#: Kind of file to its model.
MODELS: dict[str, type[BaseModel]] = {
    "stations": StationConfig,
    "tables": TableProfile,
    "imus": ImuProfile,
    "products": ProductConfig,
}

#: Put in place of a value to find its line; a private character that no file has.
_MARKER = "\ue000"

#: What only files of a kind have, as patterns of a line's beginning.
_MARKS = {
    "stations": (r"\[site\]",),
    "imus": (r"\[frame\]", r"\[stream\]", r"\[noise\]"),
    "products": (r"serial_pattern\s*=", r"\[limits"),
    "tables": (r"\[outer\]", r"\[inner\]", r"\[modbus\]", r"\[text\]", r"outer_axis\s*="),
}

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")
#: How a rule over several values begins when it names the one to mend.
_NAMED = re.compile(r"([a-z_]\w*(?:\.[a-z_]\w*)+)( is missing)?\b")
_TOML_PLACE = re.compile(r"\(at (?:line (\d+), column \d+|end of document)\)")


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong in a text.

    Attributes
    ----------
    place : where; () where it is of the whole
    kind : pydantic's, e.g. ``missing`` or ``greater_than``; ``toml`` where the text is no TOML, ``value_error`` for
        everything that a sentence of our own says
    text : what is wrong, with the mend, as the loader would say it
    line : from 1
    values : what the sentence is made of, for who says it in another language
    """

    place: KeyPath
    kind: str
    text: str
    line: int
    values: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ConfigFile:
    """A file of a kind: its name, where it is, whether it is the site's own or a shipped default."""

    name: str
    path: Path
    shipped: bool


def list_files(kind: str) -> list[ConfigFile]:
    """All files of a kind, sorted; a site's file hides the shipped one of its name."""
    return [
        ConfigFile(name, path, path.is_relative_to(library.shipped_folder()))
        for name, path in ((name, library.find(kind, name)) for name in library.names(kind))
    ]


def detect_kind(path: Path, text: str) -> str:
    """What kind of file it is: by its folder where that is one of ours, else by the tables in it.

    Raises ConfigurationError where neither tells.
    """
    if path.absolute().parent.name in MODELS:
        return path.absolute().parent.name
    for kind, marks in _MARKS.items():
        if any(re.search(rf"^\s*{mark}", text, re.MULTILINE) for mark in marks):
            return kind
    raise ConfigurationError(
        f"{path}: is no station, table, IMU or product file; put it into a folder {', '.join(MODELS)} of its kind"
    )


def check(kind: str, text: str) -> list[Problem]:
    """All that is wrong with the text of a file, by the rules with which it is loaded; [] where it may be saved."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as exc:
        found = _TOML_PLACE.search(str(exc))
        line = int(found[1]) if found and found[1] else text.count("\n") + 1
        return [Problem((), "toml", f"not valid TOML: {_TOML_PLACE.sub('', str(exc)).strip()}", line)]
    problems = check_data(kind, data)
    return [Problem(p.place, p.kind, p.text, line_of(text, p.place), p.values) for p in problems]


def check_data(kind: str, data: Mapping[str, Any]) -> list[Problem]:
    """What is wrong with the data of a file; as `check`, without lines."""
    model = MODELS[kind]
    problems = _complaints((), model, data)
    if problems:
        return problems
    checked = model.model_validate(data)
    if isinstance(checked, StationConfig):
        return _of_station(checked)
    return _of_product(checked) if isinstance(checked, ProductConfig) else []


def _of_station(station: StationConfig) -> list[Problem]:
    """What its model cannot see: the table's profile, and the virtual bench's own settings."""
    problems = _unknown_profile(("table", "profile"), "tables", station.table.profile)
    if station.bench is not None:
        from calstation.bench.config import BenchConfig

        problems += _complaints(("bench",), BenchConfig, station.bench)
    return problems


def _of_product(product: ProductConfig) -> list[Problem]:
    """What its model cannot see: the IMU's profile, the stages and their schedules, the names of targets."""
    problems = _unknown_profile(("imu",), "imus", product.imu)
    if not product.limits:
        text = "limits are missing; add [limits.NAME] before a unit is judged by it"
        problems.append(Problem((), "missing", text, 0, {"field": "limits"}))
    if not problems:
        problems += _no_room(product)
    problems += _unknown_targets(("targets",), product.targets)
    for stage in dict.fromkeys((*product.stages, *product.schedule)):
        place: KeyPath = ("schedule", stage) if stage in product.schedule else ("stages",)
        try:
            chosen = method(stage)
        except ConfigurationError as exc:
            problems.append(Problem(place, "value_error", str(exc), 0))
            continue
        values = schedule_values(product, stage, {})
        problems += _complaints(place, chosen.schedule, values)
        targets = values.get("targets")
        if place[0] == "schedule" and isinstance(targets, dict) and targets != product.targets:
            problems += _unknown_targets((*place, "targets"), targets)
    return problems


def _no_room(product: ProductConfig) -> list[Problem]:
    """Limits that the unit's registers do not hold; a profile that is wrong itself is told by its own file."""
    try:
        profile = load_imu_profile(library.find("imus", product.imu))
    except ConfigurationError:
        return []
    return [
        Problem(place, "value_error", f"{'.'.join(place)} {words}", 0)
        for place, words in check_register_limits(product, profile)
    ]


def _complaints(place: KeyPath, model: type[BaseModel], data: Any) -> list[Problem]:
    """What a model finds wrong with the data at `place`."""
    prefix = "".join(f"{part}." for part in place)
    found = []
    for c in complaints(model, data):
        named = _NAMED.match(str(c.values.get("error", "")))
        where: KeyPath = (*place, *c.place)
        if named and not place and not getattr(c.values.get("error"), "place", ()):
            own = named[1].split(".")
            where = (*(c.place[:-1] if c.place[-1:] == (own[0],) else c.place), *own)
        kind = "missing" if named and named[2] else c.kind
        found.append(Problem(where, kind, prefix + c.text, 0, c.values))
    return found


def _unknown_profile(place: KeyPath, kind: str, name: str) -> list[Problem]:
    known = library.names(kind)
    if name in known:
        return []
    text = f"{'.'.join(map(str, place))} = '{name}' does not exist; choose from: {', '.join(known)}"
    return [Problem(place, "no_profile", text, 0, {"value": name, "known": ", ".join(known)})]


def _unknown_targets(place: KeyPath, targets: Mapping[str, Any]) -> list[Problem]:
    """A target of no parameter would count as reached at once."""
    text = "{} is no parameter or group; remove it"
    return [
        Problem((*place, name), "value_error", text.format(".".join(map(str, (*place, name)))), 0)
        for name in targets
        if not named(name)
    ]


def edit_toml(text: str, changes: Mapping[KeyPath, Any]) -> str:
    """The text with some values changed and everything else, comments included, as it was.

    Parameters
    ----------
    changes : by place; None takes the value away, and its table where that is then empty
    """
    document = tomlkit.parse(text)
    made = []
    for place, value in changes.items():
        if value is None:
            _remove(document, place)
            continue
        table: Any = document
        for key in place[:-1]:
            if key not in table:
                table[key] = tomlkit.table()
                made.append(table[key])
            table = table[key]
        table[place[-1]] = value
    for table in made:
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
    """Whether a file may be called so."""
    return _NAME.fullmatch(name) is not None


def new_name(kind: str, name: str) -> str:
    """A name for a new file, checked. Raises ConfigurationError where it cannot be one or is taken."""
    if not is_name(name):
        raise ConfigurationError(
            f"'{name}' is no file name; use letters, digits, - and _, a letter or digit first"
        )
    if name in library.names(kind):
        raise ConfigurationError(f"'{name}' exists already; choose another name")
    return name


def read_text(path: Path) -> str:
    """A file's text. Raises ConfigurationError where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as exc:
        raise ConfigurationError(f"{path}: cannot be read ({exc})") from exc


def is_bench(path: Path) -> bool:
    """Whether a station file is a virtual bench; False where it cannot be read."""
    try:
        return "bench" in read_toml(path)
    except ConfigurationError:
        return False


def line_of(text: str, keys: KeyPath) -> int:
    """Line (from 1) of the value at `keys` in a valid TOML text, or of the innermost table that would hold it."""
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
        item.comment(_MARKER)  # stands on the line of the table's header
    else:
        parent[last] = _MARKER
    return tomlkit.dumps(document).partition(_MARKER)[0].count("\n") + 1


def frame_size(frame: Mapping[str, Any]) -> tuple[int, bool] | None:
    """Bytes of a frame with all its fields, and whether all frames have as many; None where its section is wrong.

    Parameters
    ----------
    frame : the section `[frame]` as it stands in the file
    """
    try:
        section = FrameSection.model_validate(frame)
    except ValidationError:
        return None
    return section.min_size(), section.format == "binary" and section.length is None
