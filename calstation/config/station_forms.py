"""The forms for lists of a station file: instruments and signatories of the laboratory, and badges of the operators."""

from dataclasses import replace

from calstation.config.forms import Form, FormCell, FormRow, ReadValue, cell_of, entry_rows, fixed_columns, keys_of
from calstation.schema import KeyPath

_SIGNATORIES: KeyPath = ("laboratory", "signatories")
_NAMES: KeyPath = ("sign_in", "names")
_ENGINEERS: KeyPath = ("sign_in", "engineers")


def _instrument_cells(_: ReadValue, key_path: KeyPath) -> tuple[FormCell, ...]:
    return (
        *(FormCell((*key_path, key), kind="text") for key in ("name", "serial")),
        replace(cell_of("stations", (*key_path, "kind")), default=None),  # the default applies to logs only
        FormCell((*key_path, "certificate"), kind="text"),
        *(FormCell((*key_path, key), kind="date") for key in ("calibrated", "due")),
    )


def _badge_rows(get: ReadValue) -> list[FormRow]:
    engineers = get(_ENGINEERS)
    badges = [*keys_of(get(_NAMES)), *(map(str, engineers) if isinstance(engineers, list) else ())]
    return [
        FormRow(
            badge,
            (
                FormCell((*_NAMES, badge), kind="text"),
                FormCell(_ENGINEERS, kind="choice", member=badge, choices=(True, False)),
            ),
            ((*_NAMES, badge),),
        )
        for badge in dict.fromkeys(badges)
    ]


INSTRUMENTS = Form(
    "instruments",
    "stations",
    (("instruments",),),
    fixed_columns("instrument", "instrument_serial", "instrument_kind", "certificate", "calibrated", "due"),
    entry_rows(("instruments",), _instrument_cells),
    "number",
    new_entry=lambda *_: {"name": ""},
)

SIGNATORIES = Form(
    "signatories",
    "stations",
    (_SIGNATORIES,),
    fixed_columns("signatory"),
    entry_rows(_SIGNATORIES, lambda _, key_path: [FormCell(key_path, kind="text")]),
    "number",
    new_entry=lambda *_: "",
)

BADGES = Form(
    "badges",
    "stations",
    (_NAMES, _ENGINEERS),
    fixed_columns("badge_name", "badge_engineer"),
    _badge_rows,
    "text",
    new_value="",
)
