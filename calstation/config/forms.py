"""Forms for files and schedules. Pydantic models describe the fields; values are in display units."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import date
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from calstation.config.editing import field_of, required_type
from calstation.physics import from_unit, in_unit
from calstation.schema import KeyPath, Problem, value_at

#: Function that returns the value at a key path of a file, or None.
ReadValue = Callable[[KeyPath], Any]

#: Display unit and its size in SI.
Unit = tuple[str, float]

NO_UNIT: Unit = ("", 1.0)

#: Kinds of problems that prevent the entries of a file from being shown in a form.
_UNREADABLE = ("toml", "file", "model_type", "dict_type", "list_type")

#: Kinds of fields by the type of their values.
_KINDS: dict[Any, Any] = {bool: "flag", int: "count", float: "number", str: "text", list: "vector", Literal: "choice"}

#: Units by the name of a field; those below apply to the last word of the name.
_UNITS = {"velocity_sigma": "m/s", "force_scatter": "m/s²", "speed": "×", "agreement_c": "K"}
_UNITS_BY_END = {
    "deg": "°",
    "dps": "°/s",
    "dps2": "°/s²",
    "arcsec": "″",
    "m": "m",
    "mps2": "m/s²",
    "s": "s",
    "ppm": "ppm",
    "c": "°C",
}


@dataclass(frozen=True)
class FieldSpec:
    """A field of a form, described by the model of its value."""

    name: str
    kind: Literal["number", "count", "flag", "choice", "text", "vector", "targets", "other"]
    unit: str  #: Unit of the value; empty if there is none.
    low: float | None = None
    above: bool = False  #: Whether the value must be greater than `low`, not equal to it.
    high: float | None = None
    optional: bool = False  #: Whether the value may be None.
    choices: tuple[Any, ...] = ()
    default: Any = None  #: None also for a required value.
    description: str = ""  #: Description from the model.


def _unit(name: str) -> str:
    """Return the unit of a field by its name; a name such as ``ramp_c_per_min`` has a quotient of units."""
    quantity, _, divisor = name.partition("_per_")
    unit = _UNITS.get(name) or _UNITS_BY_END.get(quantity.rpartition("_")[2], "")
    return f"{unit}/{divisor}" if unit and divisor else unit


def field_spec(name: str, info: FieldInfo | None) -> FieldSpec:
    """Describe a field by its model; a field without a model is a number."""
    unit = _unit(name)
    if info is None:
        return FieldSpec(name, "number", unit)
    kind, optional = required_type(info.annotation)
    bounds = {key: float(getattr(m, key)) for m in info.metadata for key in ("ge", "gt", "le", "lt") if hasattr(m, key)}
    return FieldSpec(
        name=name,
        kind=_KINDS.get(get_origin(kind) or kind, "other"),
        unit=unit,
        low=bounds.get("ge", bounds.get("gt")),
        above="ge" not in bounds and "gt" in bounds,
        high=bounds.get("le", bounds.get("lt")),
        optional=optional,
        choices=get_args(kind) if get_origin(kind) is Literal else (),
        default=None if info.is_required() else info.get_default(call_default_factory=True),
        description=info.description or "",
    )


@dataclass(frozen=True)
class FormCell:
    """A value of a file in a table.

    key_path : key path of the value, or of the interval that it limits
    kind : type of the value: a number, a text, names separated by commas, a date as YYYY-MM-DD, one of `choices`, where
        None omits the entry, or ``entries``, the number of entries, which is read-only
    end : 0 for the lowest value of an interval, 1 for the highest
    magnitude : whether the interval may also be a single number, which means ± this number
    component : number of the component of a vector, 0 to 2; all components are 0 if the file has no vector
    member : text that the cell adds to or removes from a list; its value is True if the list contains the text
    default : value if the file does not contain the entry
    """

    key_path: KeyPath
    unit: Unit = NO_UNIT
    kind: Literal["number", "text", "names", "date", "entries", "choice"] = "number"
    end: int | None = None
    magnitude: bool = False
    component: int | None = None
    member: str | None = None
    choices: tuple[Any, ...] = ()
    default: Any = None

    @property
    def editable(self) -> bool:
        """Whether the value can be edited in the table."""
        return self.kind != "entries"

    def value(self, get: ReadValue) -> Any:
        """Return the value in the file, or None."""
        value, part = get(self.key_path), self._part
        if self.member is not None:
            return isinstance(value, list) and self.member in value
        if part is None:
            return value
        if isinstance(value, list):
            return value[part] if part < len(value) else None
        return -value if self.end == 0 and isinstance(value, float | int) else value

    def is_set(self, get: ReadValue) -> bool:
        """Return whether the file contains the value itself; False for a default and the lower end of a ± interval."""
        value = get(self.key_path)
        if self.member is not None:
            return bool(self.value(get))
        return value is not None and (self.end != 0 or isinstance(value, list))

    def displayed(self, get: ReadValue) -> Any:
        """Return the choice, or the value (else the default) as text in the display unit."""
        value = self.value(get)
        value = self.default if value is None else value
        if self.kind == "choice":
            return value
        if self.kind == "entries":
            return str(len(value)) if isinstance(value, Mapping) else "0"
        if value is None:
            return ""
        if isinstance(value, list):
            return ", ".join(map(str, value))
        if isinstance(value, float) or (isinstance(value, int) and self.unit[1] != 1.0):
            return in_unit(value, self.unit[1])
        return str(value)

    def changes(self, get: ReadValue, entered: Any) -> dict[KeyPath, Any]:
        """Return the changes to the file for an entered text or choice; empty if it is already displayed.

        A text that is not a number is stored unchanged, so that the validation of the file reports it.
        """
        value = self._parse(entered)
        if self.member is not None:
            return self._member_changes(get(self.key_path), present=bool(value))
        if self.component is not None and value is None:
            value = 0.0
        if value == self._parse(self.displayed(get)):
            return {}
        present = get(self.key_path)
        if self.component is not None:
            if isinstance(present, list) and len(present) == 3:
                return {(*self.key_path, self.component): value}
            return {self.key_path: [value if axis == self.component else 0.0 for axis in range(3)]}
        if self.end is None:
            return {self.key_path: "" if value is None and isinstance(self.key_path[-1], int) else value}
        if self.magnitude and not isinstance(present, list) and (self.end == 1 or value is None):
            return {self.key_path: value} if self.end == 1 else {}
        if self.magnitude and self.end == 0 and self._follows(value, present):
            return {self.key_path: present[1]}  # the lowest value follows the highest again
        if isinstance(present, list) and len(present) == 2 and value is not None:
            return {(*self.key_path, self.end): value}
        ends = [*present, "", ""] if isinstance(present, list) else ["", ""]
        if isinstance(present, float | int):
            ends = [-present, present]
        ends[self.end] = "" if value is None else value
        return {self.key_path: None if ends[:2] == ["", ""] else ends[:2]}

    def in_display_unit(self, problem: Problem) -> Problem:
        """Convert the numbers in a problem of the value to the display unit."""
        values = {
            key: value / self.unit[1] if isinstance(value, float) else value
            for key, value in problem.what.values.items()
        }
        return replace(problem, what=replace(problem.what, values=values))

    def matches(self, problem: Problem) -> bool:
        """Return whether a problem concerns this value."""
        length, part = len(self.key_path), self._part
        inside = problem.key_path[:length] == self.key_path
        if self.member is not None and len(problem.key_path) > length:
            return inside and value_at(problem.data, problem.key_path) == self.member
        return inside and (part is None or problem.key_path[length : length + 1] in ((), (part,)))

    @property
    def _part(self) -> int | None:
        """Number of the element of a list, or None for the whole value."""
        return self.end if self.component is None else self.component

    def _follows(self, lowest: Any, interval: Any) -> bool:
        """Return whether an entered lowest value is empty or equals minus the highest value, as displayed."""
        highest = interval[1] if isinstance(interval, list) and len(interval) == 2 else None
        if not (isinstance(highest, float | int) and highest > 0):
            return False
        return lowest is None or lowest in (-highest, self._parse(in_unit(-highest, self.unit[1])))

    def _member_changes(self, names: Any, *, present: bool) -> dict[KeyPath, Any]:
        """Return the change that adds the member to a list or removes it; the last member is removed with the list."""
        names = names if isinstance(names, list) else []
        if present == (self.member in names):
            return {}
        return {self.key_path: [*names, self.member] if present else [n for n in names if n != self.member] or None}

    def _parse(self, entered: Any) -> Any:
        """Convert a text or choice to the value for the file, which is None for an empty text."""
        if self.kind == "choice":
            return entered
        text = str(entered).strip()
        if self.kind == "names":
            return [name.strip() for name in text.split(",")] if text else None
        if self.kind == "text":
            return text or None
        if self.kind == "date":
            with suppress(ValueError):
                return date.fromisoformat(text)
            return text or None
        try:
            return from_unit(float(text), self.unit[1]) if self.unit[1] != 1.0 else _number(text)
        except ValueError:
            return text or None


@dataclass(frozen=True)
class FormRow:
    """A row of a form, named after a parameter, a group or a key of the file.

    A text in place of a cell cannot be edited. `key_paths` are the entries that are removed together with the row.
    """

    name: str
    cells: tuple[FormCell | str, ...]
    key_paths: tuple[KeyPath, ...] = ()


@dataclass(frozen=True)
class FormColumn:
    """A column of a form; `key` selects its heading, into which a stage and a unit may be inserted."""

    key: str
    stage: str = ""
    unit: str = ""


@dataclass(frozen=True)
class Form:
    """A form for some of the entries of a kind of file.

    roots : entries that contain the values; new rows are added to the first one
    names : kind of row names; with ``text``, the user types the name of a new row
    offered : names of the rows that can be added
    new_entry : if the rows are the entries of an ordered list, function that returns a new entry; its last argument is
        the model of the file, or None for an invalid file
    new_value : value of a new row that is not an entry of a list
    """

    name: str
    kind: str
    roots: tuple[KeyPath, ...]
    columns: Callable[[ReadValue], list[FormColumn]]
    rows: Callable[[ReadValue], list[FormRow]]
    names: Literal["parameter", "key", "number", "text"]
    offered: tuple[str, ...] = ()
    new_entry: Callable[[ReadValue, BaseModel | None], Any] | None = None
    new_value: Any = field(default_factory=dict)

    @property
    def listed(self) -> bool:
        """Whether the rows are the entries of an ordered list."""
        return self.new_entry is not None

    def unreadable(self, problems: Sequence[Problem]) -> Problem | None:
        """Return a problem that prevents the form from being shown, or None."""
        unreadable = (p for p in problems if p.kind in _UNREADABLE)
        return next(
            (p for p in unreadable if any(p.key_path[: len(root)] == root[: len(p.key_path)] for root in self.roots)),
            None,
        )


def cells_with_problem(rows: Sequence[FormRow], problem: Problem) -> list[FormCell]:
    """Return the cells to mark for a problem: those of its value, those in its table, or the first cell of its row."""
    for row in rows:
        cells = [cell for cell in row.cells if isinstance(cell, FormCell)]
        if concerned := [cell for cell in cells if cell.matches(problem)]:
            return concerned
        if any(problem.key_path[: len(key_path)] == key_path for key_path in row.key_paths):
            inside = [cell for cell in cells if cell.key_path[: len(problem.key_path)] == problem.key_path]
            return inside if len(inside) < len(cells) and inside else cells[:1]
    return []


def _number(text: str) -> float:
    """Convert a text to an integer if it is the text of one, or else to a float. Raises ValueError."""
    try:
        return int(text)
    except ValueError:
        return float(text)


def cell_of(kind: str, key_path: KeyPath, unit: Unit = NO_UNIT, **options: Any) -> FormCell:
    """Create the cell for an entry, with the choices and the default from the model of the file."""
    info = field_of(kind, key_path)
    if info is None:
        return FormCell(key_path, unit, **options)
    spec = field_spec(str(key_path[-1]), info)
    choices = (True, False) if spec.kind == "flag" else spec.choices
    if not choices:
        return FormCell(key_path, unit, default=spec.default, **options)
    choices = (None, *choices) if spec.optional else choices
    return FormCell(key_path, unit, "choice", choices=choices, default=spec.default)


def entry_rows(
    root: KeyPath, cells: Callable[[ReadValue, KeyPath], Iterable[FormCell | str]]
) -> Callable[[ReadValue], list[FormRow]]:
    """Return the `rows` function of a form whose rows are the entries of the list at `root`, numbered from 1."""

    def rows(get: ReadValue) -> list[FormRow]:
        entries = get(root)
        key_paths: list[KeyPath] = [(*root, i) for i in range(len(entries if isinstance(entries, list) else []))]
        return [FormRow(str(i), tuple(cells(get, key_path)), (key_path,)) for i, key_path in enumerate(key_paths, 1)]

    return rows


def fixed_columns(*keys: str) -> Callable[[ReadValue], list[FormColumn]]:
    """Return the `columns` function of a form whose columns do not depend on the values."""
    return lambda _: [FormColumn(key) for key in keys]


def keys_of(table: Any) -> list[str]:
    """Return the keys of a table, or [] for another value."""
    return list(table) if isinstance(table, Mapping) else []
