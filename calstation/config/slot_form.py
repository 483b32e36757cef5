"""The form for a station's slots, and the conversion of a station file between a single unit and slots."""

from dataclasses import replace
from typing import Any

from pydantic import BaseModel

from calstation.config import library
from calstation.config.blocks import arrange_entries, has_table, replace_header
from calstation.config.editing import edit_toml
from calstation.config.forms import Form, FormCell, FormColumn, ReadValue, cell_of, entry_rows
from calstation.config.slots import DeviceSection, SlotSection
from calstation.parsing import parse_toml
from calstation.physics import ORIENTATIONS, unit_of
from calstation.schema import KeyPath

#: Display unit of a lever arm.
_LENGTH = unit_of("m")

#: All orientations, grouped by the body axis that points up at home; z comes first, because it is the platform's.
_ORIENTATIONS = tuple(sorted(ORIENTATIONS, key=lambda name: ("zxy".index(name[3]), name[2], name)))


def _has_ports(get: ReadValue) -> bool:
    return get(("bench",)) is None


def _columns(get: ReadValue) -> list[FormColumn]:
    ports = ("port",) if _has_ports(get) else ()
    texts = ("name", *ports, "product", "imu", "orientation")
    return [*map(FormColumn, texts), *(FormColumn(f"lever_{axis}", unit=_LENGTH[0]) for axis in "xyz")]


def _cells(get: ReadValue, key_path: KeyPath) -> tuple[FormCell, ...]:
    texts = ("name", "port") if _has_ports(get) else ("name",)
    choices: dict[str, tuple[Any, ...]] = {
        "product": (None, *library.names("products")),
        "imu": (None, *library.names("imus")),
        "orientation": _ORIENTATIONS,
    }
    return (
        *(replace(cell_of("stations", (*key_path, key)), kind="text") for key in texts),
        *(
            replace(cell_of("stations", (*key_path, key)), kind="choice", choices=allowed)
            for key, allowed in choices.items()
        ),
        *(FormCell((*key_path, "lever_m"), _LENGTH, component=number, default=0.0) for number in range(3)),
    )


def _new_slot(get: ReadValue, _: BaseModel | None) -> dict[str, Any]:
    """Return a new slot, whose name is the first unused number that is not less than its position in the list."""
    names = [get(("slots", number, "name")) for number in range(len(get(("slots",)) or ()))]
    number = len(names) + 1
    while str(number) in names:
        number += 1
    return {"name": str(number)}


#: The form of the slots of a station.
SLOTS = Form(
    "slots", "stations", (("slots",),), _columns, entry_rows(("slots",), _cells), "number", new_entry=_new_slot
)


def with_slots(text: str) -> str:
    """Convert a station file to slots; the first slot takes the link and the comments of `[imu]`.

    A virtual bench is given a slot for each of its units.
    """
    data = parse_toml(text)
    units = data.get("bench", {}).get("units", 1)
    first = {"name": "1"}
    if has_table(text, ("imu",)):
        text = replace_header(text, ("imu",), "[[slots]]", first)
    else:
        text = arrange_entries(edit_toml(text, {("imu",): None}), "slots", [{**first, **data.get("imu", {})}])
    text = arrange_entries(text, "slots", [0, *({"name": str(number)} for number in range(2, units + 1))])
    return edit_toml(text, {("bench", "units"): None}) if "units" in data.get("bench", {}) else text


def with_one_unit(text: str) -> str:
    """Convert the single slot of a station file to `[imu]`, with its link and its comments."""
    (slot,) = parse_toml(text)["slots"]
    link = {key: value for key, value in slot.items() if key in DeviceSection.model_fields}
    if not (link and has_table(text, ("slots", 0))):
        text = arrange_entries(text, "slots", [])
        return edit_toml(text, {("imu",): link}) if link else text
    slot_keys = SlotSection.model_fields.keys() - DeviceSection.model_fields.keys()
    text = edit_toml(text, {("slots", 0, key): None for key in sorted(slot_keys)})
    return replace_header(text, ("slots", 0), "[imu]", {})
