"""A profile or product as a person reads it: sections of labels and values, in people's units."""

from collections.abc import Mapping, Sequence
from typing import Any

from PySide6.QtCore import QCoreApplication
from PySide6.QtWidgets import QHeaderView, QTreeWidget, QTreeWidgetItem

from calstation.config.frame_size import frame_size
from calstation.config.schedules import UNITS
from calstation.gui.engineer.field_wording import word_field
from calstation.gui.text.messages import term
from calstation.gui.widgets import theme
from calstation.physics.parameters import GROUPS
from calstation.physics.units import (
    ARCSECOND,
    DEGREE,
    DEGREE_PER_HOUR,
    DEGREE_PER_ROOT_HOUR,
    DISPLAY,
    MICRO_G,
)

#: A title and its lines of label and value.
Section = tuple[str, list[tuple[str, str]]]


translate = QCoreApplication.translate


def readable(kind: str, data: Mapping[str, Any]) -> list[Section]:
    """The sections of a file's data; what is not as it should be is left to the text and its marks."""
    if kind == "products":
        return _product(data)
    return _imu(data) if kind == "imus" else _plain(data)


def _product(data: Mapping[str, Any]) -> list[Section]:
    stages = _names(data.get("stages"))
    warm_up, load = _table(data, "warm_up"), _table(data, "load_angle")
    unit = [
        (translate("station_readable", "Name"), _text(data.get("name"))),
        (translate("station_readable", "IMU profile"), _text(data.get("imu"))),
        (translate("station_readable", "Serial number (pattern)"), _text(data.get("serial_pattern"))),
        (translate("station_readable", "Stages"), " → ".join(term("stage", stage) for stage in stages)),
        (translate("station_readable", "Warm-up"), f"{_text(warm_up.get('time_s', 0.0))} s"),
        (
            translate("station_readable", "Load angle"),
            f"{_text(load.get('outer_deg', 0.0))}° / {_text(load.get('inner_deg', 0.0))}°",
        ),
        (
            translate("station_readable", "A missed limit"),
            translate("station_readable", "ends the run early")
            if data.get("end_on_failure")
            else translate("station_readable", "lets the other stages go on"),
        ),
    ]
    sections: list[Section] = [(translate("station_readable", "Unit type"), unit)]
    for stage, schedule in _table(data, "schedule").items():
        if isinstance(schedule, Mapping):
            lines = [
                (word_field(key), f"{_text(value)} {_unit(key)}".strip()) for key, value in schedule.items()
            ]
            sections.append(
                (translate("station_readable", "Schedule: {0}").format(term("stage", stage)), lines)
            )
    limits = [
        (_group_name(name), _limit(name, limit))
        for name, limit in _table(data, "limits").items()
        if isinstance(limit, Mapping)
    ]
    sections.append((translate("station_readable", "Limits"), limits))
    return sections


def _imu(data: Mapping[str, Any]) -> list[Section]:
    link, stream, noise, frame = (_table(data, name) for name in ("link", "stream", "noise", "frame"))
    increments = stream.get("output") == "increment"
    gyro, accel = (("″", ARCSECOND), ("µm/s", 1e-6)) if increments else (("°/s", DEGREE), ("µg", MICRO_G))
    line = (
        f"{link.get('baud', 115200)} {link.get('data_bits', 8)}{link.get('parity', 'N')}"
        f"{link.get('stop_bits', 1):g}"
    )
    order = {
        "before_registers": translate("station_readable", "before the unit's registers"),
        "after_registers": translate("station_readable", "behind the unit's registers"),
    }
    fields = [field.get("name") for field in frame.get("fields", []) if isinstance(field, Mapping)]
    registers = [entry for entry in data.get("registers", []) if isinstance(entry, Mapping)]
    sections: list[Section] = [
        (
            translate("station_readable", "Unit"),
            [
                (translate("station_readable", "Name"), _text(data.get("name"))),
                (translate("station_readable", "Model name contains"), _text(data.get("model"))),
                (translate("station_readable", "Serial line"), line),
            ],
        ),
        (
            translate("station_readable", "Stream"),
            [
                (translate("station_readable", "Sample rate"), f"{_text(stream.get('sample_rate_hz'))} Hz"),
                (
                    translate("station_readable", "A sample is"),
                    translate("station_readable", "an increment")
                    if increments
                    else translate("station_readable", "a mean rate"),
                ),
                (translate("station_readable", "Gyro, per count"), _in(stream.get("gyro_lsb"), *gyro)),
                (
                    translate("station_readable", "Accelerometer, per count"),
                    _in(stream.get("accel_lsb"), *accel),
                ),
                (
                    translate("station_readable", "Taken"),
                    order.get(str(stream.get("order")), _text(stream.get("order"))),
                ),
            ],
        ),
        (
            translate("station_readable", "Noise"),
            [
                (
                    translate("station_readable", "Angle random walk"),
                    _in(noise.get("gyro_arw"), "°/√h", DEGREE_PER_ROOT_HOUR),
                ),
                (
                    translate("station_readable", "Velocity random walk"),
                    _in(noise.get("accel_vrw"), "µg/√Hz", MICRO_G),
                ),
                (
                    translate("station_readable", "Gyro bias instability"),
                    _in(noise.get("gyro_bias_instability", 0.0), "°/h", DEGREE_PER_HOUR),
                ),
                (
                    translate("station_readable", "Accelerometer bias instability"),
                    _in(noise.get("accel_bias_instability", 0.0), "µg", MICRO_G),
                ),
            ],
        ),
        (
            translate("station_readable", "Frame"),
            [
                (translate("station_readable", "Begins with"), _text(frame.get("sync"))),
                (translate("station_readable", "Fields"), ", ".join(_text(name) for name in fields)),
                (translate("station_readable", "Size"), _size(frame)),
                (
                    translate("station_readable", "Check"),
                    _text(_table(frame, "crc").get("kind") or _table(frame, "check").get("kind")),
                ),
            ],
        ),
    ]
    if registers:
        lines = [(_address(entry), _register(_names(entry.get("parameters")))) for entry in registers]
        sections.append((translate("station_readable", "Calibration registers"), lines))
    known = [
        (_group_name(name), _in_group(name, prior.get("sigma"), "± "))
        for name, prior in _table(data, "prior").items()
        if isinstance(prior, Mapping)
    ]
    if known:
        sections.append((translate("station_readable", "Known of any unit beforehand (one sigma)"), known))
    return sections


def _size(frame: Mapping[str, Any]) -> str:
    """What the frame's parts add up to."""
    found = frame_size(frame)
    if found is None:
        return "–"
    size, fixed = found
    if fixed:
        return translate("station_readable", "{0} bytes").format(size)
    return translate("station_readable", "{0} bytes and more").format(size)


def _address(entry: Mapping[str, Any]) -> str:
    """A register as documents write it, decimal and hexadecimal, on its page."""
    address = entry.get("address")
    told = f"{address} (0x{address:X})" if isinstance(address, int) else _text(address)
    page = entry.get("page", 0)
    return translate("station_readable", "{0}, page {1}").format(told, page) if page else told


def _unit(key: str) -> str:
    """Unit of a schedule's value by the end of its name, the longest that fits."""
    ends = [end for end in UNITS if key.endswith(end)]
    return UNITS[max(ends, key=len)] if ends else ""


def _register(names: Sequence[str]) -> str:
    """The parameters of neighbouring registers, those of a matrix by their ends."""
    named = [name for name in names if name]
    return ", ".join(named) if len(named) <= 3 else f"{named[0]} … {named[-1]} ({len(named)})"


def _plain(data: Mapping[str, Any]) -> list[Section]:
    """Keys and values as they stand in the file."""
    top = [(key, _text(value)) for key, value in data.items() if not isinstance(value, Mapping)]
    sections: list[Section] = [(translate("station_readable", "General"), top)] if top else []
    for key, value in data.items():
        if isinstance(value, Mapping):
            sections.append((key, [(name, _text(inner)) for name, inner in value.items()]))
    return sections


def _table(data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    found = data.get(key)
    return found if isinstance(found, Mapping) else {}


def _names(value: Any) -> list[str]:
    return [str(name) for name in value] if isinstance(value, list) else []


def _text(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return translate("station_readable", "yes") if value else translate("station_readable", "no")
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_text(inner)}" for key, inner in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_text(inner) for inner in value)
    return str(value)


def _in(value: Any, unit: str, size: float) -> str:
    return f"{value / size:.4g} {unit}" if isinstance(value, float | int) else _text(value)


def _group_of(name: str) -> str:
    return name if name in GROUPS else name.rpartition("_")[0]


def _group_name(name: str) -> str:
    group = _group_of(name)
    return term("group", name) if group == name else f"{term('group', group)} {name.rpartition('_')[2]}"


def _in_group(name: str, value: Any, sign: str = "") -> str:
    unit, size = DISPLAY.get(_group_of(name), ("", 1.0))
    return sign + _in(value, unit, size)


def _limit(name: str, limit: Mapping[str, Any]) -> str:
    """A limit as a sentence: within, sigma below."""
    parts = []
    within = limit.get("within")
    if isinstance(within, list) and len(within) == 2:
        parts.append(f"{_in_group(name, within[0])} … {_in_group(name, within[1])}")
    elif within is not None:
        parts.append(_in_group(name, within, "± "))
    if limit.get("sigma_below") is not None:
        parts.append(f"σ ≤ {_in_group(name, limit['sigma_below'])}")
    for stage, sigma in _table(limit, "sigma_below_after").items():
        text = translate("station_readable", "σ ≤ {0} after “{1}” alone")
        parts.append(text.format(_in_group(name, sigma), term("stage", stage)))
    return ";  ".join(parts)


class ReadableView(QTreeWidget):
    """Shows the sections, all unfolded."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("readable_view")
        self.setColumnCount(2)
        self.setHeaderHidden(True)
        self.setProperty("kind", "readable")
        self.setRootIsDecorated(False)
        self.setIndentation(2 * theme.GRID)
        self.setWordWrap(True)
        self.setSelectionMode(QTreeWidget.SelectionMode.NoSelection)
        self.header().setSectionResizeMode(0, QHeaderView.ResizeMode.ResizeToContents)
        self.header().setStretchLastSection(True)

    def show_data(self, kind: str, data: Mapping[str, Any]) -> None:
        """Show a file's data."""
        self.clear()
        bold = theme.font(bold=True)
        for title, lines in readable(kind, data):
            top = QTreeWidgetItem(self, [title])
            top.setFont(0, bold)
            top.setFirstColumnSpanned(True)
            for label, value in lines:
                line = QTreeWidgetItem(top, [label, value])
                line.setToolTip(1, value)
            top.setExpanded(True)
