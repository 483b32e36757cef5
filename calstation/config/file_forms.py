"""The forms for products and IMU profiles: limits, check standards, two-person rules, noise, priors and registers."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, get_args

from pydantic import BaseModel

from calstation.config.forms import (
    NO_UNIT,
    Form,
    FormCell,
    FormColumn,
    FormRow,
    ReadValue,
    Unit,
    cell_of,
    entry_rows,
    fixed_columns,
    keys_of,
)
from calstation.config.product import ConfirmationSection
from calstation.devices.codecs import SENSORS
from calstation.devices.profiles import ImuProfile
from calstation.physics import (
    EFFECT_PARAMETERS,
    EFFECT_STATES,
    GROUPS,
    NAMES,
    PAIR_PARAMETERS,
    unit_of,
    unit_of_parameter,
)
from calstation.schema import KeyPath

_MIXED_UNITS: Unit = ("SI", 1.0)

#: Number types offered for a register map; other types can be entered.
_TYPES = ("f32", "f64", "i16", "i32", "u16", "u32", "q2.30", "q16.16")


def _unit(name: str) -> Unit:
    """Return the display unit of a parameter or group; an unknown name has no unit and is reported elsewhere."""
    try:
        return unit_of_parameter(name)
    except KeyError:
        return NO_UNIT


def _limit_stages(get: ReadValue) -> list[str]:
    """Return the stages for which a limit specifies a separate sigma for partial runs."""
    limits = get(("limits",))
    return list(
        dict.fromkeys(s for name in keys_of(limits) for s in keys_of(get(("limits", name, "sigma_below_after"))))
    )


def _limit_columns(get: ReadValue) -> list[FormColumn]:
    after = [FormColumn("sigma_below_after", stage) for stage in _limit_stages(get)]
    return [*map(FormColumn, ("unit", "lowest", "highest", "sigma_below")), *after, FormColumn("target")]


def _limit_rows(get: ReadValue) -> list[FormRow]:
    rows = []
    for name in dict.fromkeys((*keys_of(get(("limits",))), *keys_of(get(("targets",))))):
        unit, key_path = _unit(name), ("limits", name)
        ends = (cell_of("products", (*key_path, "within"), unit, end=end, magnitude=True) for end in (0, 1))
        after = ((*key_path, "sigma_below_after", stage) for stage in _limit_stages(get))
        sigmas = ((*key_path, "sigma_below"), *after, ("targets", name))
        cells: tuple[FormCell | str, ...] = (unit[0], *ends, *(cell_of("products", sigma, unit) for sigma in sigmas))
        rows.append(FormRow(name, cells, (key_path, ("targets", name))))
    return rows


def _noise_rows(get: ReadValue) -> list[FormRow]:
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


def _prior_rows(get: ReadValue) -> list[FormRow]:
    rows = []
    for name in dict.fromkeys((*keys_of(get(("prior",))), *keys_of(get(("stability",))))):
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


def _register_cells(get: ReadValue, key_path: KeyPath) -> Iterator[FormCell | str]:
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
            cell = cell_of("imus", (*key_path, key), unit if key == "tolerance" else NO_UNIT)
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
        return NO_UNIT
    return _unit(f"{sensor}_bias" if slot.startswith("offset") else name)


def _new_register(_: ReadValue, profile: BaseModel | None) -> dict[str, Any]:
    """Return a new entry of the register map at the next free address; the register contains 0 until it is named."""
    if not isinstance(profile, ImuProfile) or not profile.registers:
        return {"address": 0, "parameters": [""], "range": [-1.0, 1.0]}
    last = profile.registers[-1]
    page = {"page": last.page} if last.page else {}
    return {**page, "address": last.end, "parameters": [""], "range": list(last.range)}


#: Names of groups and of matrices that are offered as register contents.
_CONTENTS = (*GROUPS, *(f"{sensor}_{kind}" for sensor in SENSORS for kind in ("matrix", "offset")), *EFFECT_STATES)

#: Parameters that are compared with the reference of a check standard; the outer lever arm depends on the mounting.
_COMPARED = tuple(name for name in NAMES if not name.startswith("outer_lever"))

_OTHER_GROUPS = tuple(dict.fromkeys(p.group for p in (*PAIR_PARAMETERS, *EFFECT_PARAMETERS)))


def _standard_cells(_: ReadValue, key_path: KeyPath) -> tuple[FormCell, ...]:
    return (
        FormCell((*key_path, "serial"), kind="text"),
        FormCell((*key_path, "interval_days")),
        FormCell((*key_path, "date"), kind="date"),
        FormCell((*key_path, "reference"), kind="entries"),
    )


def reference_form(number: int) -> Form:
    """Return the form of the reference values of a check standard, given by its number from 0."""
    root: KeyPath = ("check_standards", number, "reference")

    def rows(get: ReadValue) -> list[FormRow]:
        return [
            FormRow(
                name,
                (_unit(name)[0], *(FormCell((*root, name, key), _unit(name)) for key in ("value", "sigma"))),
                ((*root, name),),
            )
            for name in keys_of(get(root))
        ]

    columns = fixed_columns("unit", "value", "reference_sigma")
    return Form("reference", "products", (root,), columns, rows, "parameter", _COMPARED)


def _confirmation_rows(_: ReadValue) -> list[FormRow]:
    key_path = ("confirmation", "required_for")
    actions = get_args(get_args(ConfirmationSection.model_fields["required_for"].annotation)[0])
    return [
        FormRow(f"action_{action}", (FormCell(key_path, kind="choice", member=action, choices=(True, False)),))
        for action in actions
    ]


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
    Form(
        "check_standards",
        "products",
        (("check_standards",),),
        fixed_columns("standard_serial", "interval_days", "reference_date", "reference"),
        entry_rows(("check_standards",), _standard_cells),
        "number",
        new_entry=lambda *_: {"serial": ""},
    ),
    Form(
        "confirmation",
        "products",
        (("confirmation",),),
        fixed_columns("required_for"),
        _confirmation_rows,
        "key",
    ),
    Form("noise", "imus", (("noise",), ("stream",)), fixed_columns("value", "unit"), _noise_rows, "key"),
    Form(
        "priors",
        "imus",
        (("prior",), ("stability",)),
        fixed_columns("unit", "sigma", "power_up", "year"),
        _prior_rows,
        "parameter",
        (*GROUPS, *NAMES),
    ),
    Form(
        "registers",
        "imus",
        (("registers",),),
        fixed_columns(*_REGISTER),
        entry_rows(("registers",), _register_cells),
        "number",
        new_entry=_new_register,
    ),
)
