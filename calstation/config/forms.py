"""Forms for files and schedules, whose models describe the fields; values are in display units."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from calstation.config.editing import field_of, required_type
from calstation.devices.codecs import SENSORS
from calstation.devices.profiles import ImuProfile
from calstation.physics import (
    EFFECT_PARAMETERS,
    EFFECT_STATES,
    GROUPS,
    NAMES,
    PAIR_PARAMETERS,
    from_unit,
    in_unit,
    unit_of,
    unit_of_parameter,
)
from calstation.schema import KeyPath, Problem

#: Function that returns the value at a key path of a file, or None.
Get = Callable[[KeyPath], Any]

#: Display unit and its size in SI.
Unit = tuple[str, float]

_NO_UNIT: Unit = ("", 1.0)
_MIXED_UNITS: Unit = ("SI", 1.0)

#: Kinds of problems that prevent the entries of a file from being shown in a form.
_UNREADABLE = ("toml", "file", "model_type", "dict_type", "list_type")

#: Number types offered for a register map; other types can be entered.
_TYPES = ("f32", "f64", "i16", "i32", "u16", "u32", "q2.30", "q16.16")

#: Kinds of fields by the type of their values.
_KINDS: dict[Any, Any] = {bool: "flag", int: "count", float: "number", str: "text", list: "vector", Literal: "choice"}

#: Units by the name of a field, and below by the last word of the name.
_UNITS = {"velocity_sigma": "m/s", "speed": "×"}
_UNITS_BY_END = {
    "deg": "°",
    "dps": "°/s",
    "dps2": "°/s²",
    "arcsec": "″",
    "m": "m",
    "mps2": "m/s²",
    "s": "s",
    "ppm": "ppm",
}


@dataclass(frozen=True)
class FieldSpec:
    """A field of a form, described by the model of its value."""

    name: str
    kind: Literal["number", "count", "flag", "choice", "text", "vector", "targets", "other"]
    unit: str  #: Unit of the value; empty if it has none.
    low: float | None = None
    above: bool = False  #: Whether the value must be greater than `low`, not equal to it.
    high: float | None = None
    optional: bool = False  #: Whether the value may be None.
    choices: tuple[Any, ...] = ()
    default: Any = None  #: None also for a required value.
    description: str = ""  #: Description from the model.


def field_spec(name: str, info: FieldInfo | None) -> FieldSpec:
    """Describe a field by its model; a field without a model is a number."""
    unit = _UNITS.get(name) or _UNITS_BY_END.get(name.rpartition("_")[2], "")
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
    kind : a number, a text, names separated by commas, or one of `choices`; the choice None omits the entry
    end : 0 for the lowest value of an interval, 1 for the highest
    magnitude : whether the interval may also be a single number, which means ± this number
    component : number of the component of a vector, 0 to 2; all components are 0 if the file has no vector
    default : value if the file has none
    """

    key_path: KeyPath
    unit: Unit = _NO_UNIT
    kind: Literal["number", "text", "names", "choice"] = "number"
    end: int | None = None
    magnitude: bool = False
    component: int | None = None
    choices: tuple[Any, ...] = ()
    default: Any = None

    def value(self, get: Get) -> Any:
        """Return the value in the file, or None."""
        value, part = get(self.key_path), self._part
        if part is None:
            return value
        if isinstance(value, list):
            return value[part] if part < len(value) else None
        return -value if self.end == 0 and isinstance(value, float | int) else value

    def is_set(self, get: Get) -> bool:
        """Return whether the file contains the value itself; False for a default and the lower end of a ± interval."""
        value = get(self.key_path)
        return value is not None and (self.end != 0 or isinstance(value, list))

    def displayed(self, get: Get) -> Any:
        """Return the choice, or the text of the value or its default in the display unit."""
        value = self.value(get)
        value = self.default if value is None else value
        if self.kind == "choice":
            return value
        if value is None:
            return ""
        if isinstance(value, list):
            return ", ".join(map(str, value))
        if isinstance(value, float) or (isinstance(value, int) and self.unit[1] != 1.0):
            return in_unit(value, self.unit[1])
        return str(value)

    def changes(self, get: Get, entered: Any) -> dict[KeyPath, Any]:
        """Return the changes to the file for an entered text or choice; empty if it is already displayed.

        A text that is not a number is stored unchanged, so that the validation of the file reports it.
        """
        value = self._parse(entered)
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
            return {self.key_path: value}
        if self.magnitude and not isinstance(present, list) and (self.end == 1 or value is None):
            return {self.key_path: value} if self.end == 1 else {}
        if isinstance(present, list) and len(present) == 2 and value is not None:
            return {(*self.key_path, self.end): value}
        ends = [*present, "", ""] if isinstance(present, list) else ["", ""]
        if isinstance(present, float | int):
            ends = [-present, present]
        ends[self.end] = "" if value is None else value
        return {self.key_path: None if set(ends[:2]) == {""} else ends[:2]}

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
        return inside and (part is None or problem.key_path[length : length + 1] in ((), (part,)))

    @property
    def _part(self) -> int | None:
        """Number of the element of a list, or None for the whole value."""
        return self.end if self.component is None else self.component

    def _parse(self, entered: Any) -> Any:
        """Convert a text or choice to the value for the file, which is None for an empty text."""
        if self.kind == "choice":
            return entered
        text = str(entered).strip()
        if self.kind == "names":
            return [name.strip() for name in text.split(",")] if text else None
        if self.kind == "text":
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
    names : kind of the names of the rows
    offered : names of the rows that can be added
    new_entry : if the rows are the entries of an ordered list, function that returns a new entry; its last argument is
        the model of the file, or None for an invalid file
    """

    name: str
    kind: str
    roots: tuple[KeyPath, ...]
    columns: Callable[[Get], list[FormColumn]]
    rows: Callable[[Get], list[FormRow]]
    names: Literal["parameter", "key", "number"]
    offered: tuple[str, ...] = ()
    new_entry: Callable[[Get, BaseModel | None], dict[str, Any]] | None = None

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
    """Return the cells to mark for a problem: the cells of its value, or else the first cell of its row."""
    for row in rows:
        cells = [cell for cell in row.cells if isinstance(cell, FormCell)]
        if concerned := [cell for cell in cells if cell.matches(problem)]:
            return concerned
        if any(problem.key_path[: len(key_path)] == key_path for key_path in row.key_paths):
            inside = [cell for cell in cells if cell.key_path[: len(problem.key_path)] == problem.key_path]
            return inside if len(inside) < len(cells) and inside else cells[:1]
    return []


def _number(text: str) -> float:
    """Convert a text to a number, which is an integer if it has no decimal point. Raises ValueError."""
    try:
        return int(text)
    except ValueError:
        return float(text)


def cell_of(kind: str, key_path: KeyPath, unit: Unit = _NO_UNIT, **options: Any) -> FormCell:
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


def _keys(table: Any) -> list[str]:
    return list(table) if isinstance(table, Mapping) else []


def _unit(name: str) -> Unit:
    """Return the display unit of a parameter or group; an unknown name has no unit and is reported elsewhere."""
    try:
        return unit_of_parameter(name)
    except KeyError:
        return _NO_UNIT


def _limit_stages(get: Get) -> list[str]:
    """Return the stages for which a limit specifies a separate sigma for partial runs."""
    limits = get(("limits",))
    return list(dict.fromkeys(s for name in _keys(limits) for s in _keys(get(("limits", name, "sigma_below_after")))))


def _limit_columns(get: Get) -> list[FormColumn]:
    after = [FormColumn("sigma_below_after", stage) for stage in _limit_stages(get)]
    return [*map(FormColumn, ("unit", "lowest", "highest", "sigma_below")), *after, FormColumn("target")]


def _limit_rows(get: Get) -> list[FormRow]:
    rows = []
    for name in dict.fromkeys((*_keys(get(("limits",))), *_keys(get(("targets",))))):
        unit, key_path = _unit(name), ("limits", name)
        ends = (cell_of("products", (*key_path, "within"), unit, end=end, magnitude=True) for end in (0, 1))
        after = ((*key_path, "sigma_below_after", stage) for stage in _limit_stages(get))
        sigmas = ((*key_path, "sigma_below"), *after, ("targets", name))
        cells: tuple[FormCell | str, ...] = (unit[0], *ends, *(cell_of("products", sigma, unit) for sigma in sigmas))
        rows.append(FormRow(name, cells, (key_path, ("targets", name))))
    return rows


def _noise_rows(get: Get) -> list[FormRow]:
    rate = get(("stream", "output")) == "rate"
    gyro, accel = ("rad/s", "m/s²") if rate else ("rad", "m/s")
    units = {
        ("noise", "gyro_arw"): "rad/√s",
        ("noise", "accel_vrw"): "m/s/√s",
        ("noise", "gyro_bias_instability"): "rad/s",
        ("noise", "accel_bias_instability"): "m/s²",
        ("stream", "sample_rate_hz"): "Hz",
        ("stream", "output"): "",
        ("stream", "gyro_lsb"): gyro,
        ("stream", "accel_lsb"): accel,
        ("stream", "gyro_quantisation"): gyro,
        ("stream", "accel_quantisation"): accel,
        ("stream", "order"): "",
    }
    cells = [cell_of("imus", key_path, unit_of(unit)) for key_path, unit in units.items()]
    return [FormRow(str(cell.key_path[-1]), (cell, cell.unit[0])) for cell in cells]


def _prior_rows(get: Get) -> list[FormRow]:
    rows = []
    for name in dict.fromkeys((*_keys(get(("prior",))), *_keys(get(("stability",))))):
        unit = _unit(name)
        key_paths = (("prior", name, "sigma"), ("stability", name, "power_up"), ("stability", name, "year"))
        cells: tuple[FormCell | str, ...] = (unit[0], *(cell_of("imus", key_path, unit) for key_path in key_paths))
        rows.append(FormRow(name, cells, (("prior", name), ("stability", name))))
    return rows


#: Columns of a register; the last five are entries of its convention.
_REGISTER = (
    *("address", "page", "parameters", "type", "scale", "unit", "lowest", "highest", "tolerance", "major"),
    *("byte_order", "word_order", "span", "matrix", "identity", "negated", "offset", "added"),
)
_CONVENTION = ("matrix", "identity", "negated", "offset", "added")


def entry_rows(key: str, cells: Callable[[Get, KeyPath], Iterable[FormCell | str]]) -> Callable[[Get], list[FormRow]]:
    """Return the `rows` function of a form whose rows are the entries of a list, numbered from 1."""

    def rows(get: Get) -> list[FormRow]:
        entries = get((key,))
        key_paths: list[KeyPath] = [(key, i) for i in range(len(entries if isinstance(entries, list) else []))]
        return [FormRow(str(i), tuple(cells(get, key_path)), (key_path,)) for i, key_path in enumerate(key_paths, 1)]

    return rows


def _register_cells(get: Get, key_path: KeyPath) -> Iterator[FormCell | str]:
    content = get((*key_path, "parameters"))
    unit = _content_unit(content)
    formula = "matrix" in str(content) or "offset" in str(content) or get((*key_path, "convention")) is not None
    for key in _REGISTER:
        if key == "unit":
            yield unit[0]
        elif key in ("lowest", "highest"):
            yield cell_of("imus", (*key_path, "range"), unit, end=int(key == "highest"))
        elif not formula and key in ("major", *_CONVENTION):
            yield ""
        elif key in _CONVENTION:
            yield cell_of("imus", (*key_path, "convention", key))
        else:
            cell = cell_of("imus", (*key_path, key), unit if key == "tolerance" else _NO_UNIT)
            kind: Any = {"parameters": "names", "type": "text"}.get(key, cell.kind)
            offers = {"parameters": _CONTENTS, "type": _TYPES}.get(key, cell.choices)
            span = None if key == "span" else cell.default  # the default depends on the protocol
            yield replace(cell, kind=kind, choices=offers, default=span)


def _content_unit(names: Any) -> Unit:
    """Return the display unit of the content of a register; "SI" if its numbers have different units."""
    units = {_unit_of_content(str(name)) for name in names if name} if isinstance(names, list) else set()
    return units.pop() if len(units) == 1 else _MIXED_UNITS


def _unit_of_content(name: str) -> Unit:
    sensor, _, slot = name.partition("_")
    if slot.startswith("matrix"):
        return _NO_UNIT
    return _unit(f"{sensor}_bias" if slot.startswith("offset") else name)


def _new_register(_: Get, profile: BaseModel | None) -> dict[str, Any]:
    """Return a new entry of the register map at the next free address; it contains 0 until it is given a name."""
    if not isinstance(profile, ImuProfile) or not profile.registers:
        return {"address": 0, "parameters": [""], "range": [-1.0, 1.0]}
    last = profile.registers[-1]
    page = {"page": last.page} if last.page else {}
    return {**page, "address": last.end, "parameters": [""], "range": list(last.range)}


#: Names of groups and of matrices that are offered as register contents.
_CONTENTS = (*GROUPS, *(f"{sensor}_{kind}" for sensor in SENSORS for kind in ("matrix", "offset")), *EFFECT_STATES)

_OTHER_GROUPS = tuple(dict.fromkeys(p.group for p in (*PAIR_PARAMETERS, *EFFECT_PARAMETERS)))


def _columns(*keys: str) -> Callable[[Get], list[FormColumn]]:
    return lambda _: [FormColumn(key) for key in keys]


#: All forms, in the order in which they are offered.
FORMS = (
    Form(
        "limits",
        "products",
        (("limits",), ("targets",)),
        _limit_columns,
        _limit_rows,
        "parameter",
        (*GROUPS, *NAMES, *_OTHER_GROUPS),
    ),
    Form("noise", "imus", (("noise",), ("stream",)), _columns("value", "unit"), _noise_rows, "key"),
    Form(
        "priors",
        "imus",
        (("prior",), ("stability",)),
        _columns("unit", "sigma", "power_up", "year"),
        _prior_rows,
        "parameter",
        (*GROUPS, *NAMES),
    ),
    Form(
        "registers",
        "imus",
        (("registers",),),
        _columns(*_REGISTER),
        entry_rows("registers", _register_cells),
        "number",
        new_entry=_new_register,
    ),
)
