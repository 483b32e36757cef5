"""The table's profile: travel, rates and accelerations of both joints, their axes, and the accuracy of the angles."""

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QGridLayout, QSizePolicy, QWidget

from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import Field, Form
from calstation.gui.settings.inputs import ChoiceBox, NumberEdit, VectorEdit
from calstation.gui.text import bind, on_language_change
from calstation.gui.widgets import Words, column, label, row, theme

_JOINTS = ("outer", "inner")
_NARROW = 14 * theme.GRID

#: Heights of a joint's row and of its bar, and the width of its name, px.
_ROW, _BAR, _NAME = 11 * theme.GRID, 2 * theme.GRID, 9 * theme.GRID
#: Distances that the scale's marks may have, degrees.
_TICKS = (30, 90, 180, 360, 720, 1800, 3600)
_MOST_TICKS = 8


class TableSection(QWidget):
    """`[outer]`, `[inner]`, `[accuracy]` and the axes of the table profile's draft."""

    def __init__(self, draft: Draft) -> None:
        super().__init__()
        self._draft = draft
        self._fields: list[Field] = []
        self._file = label(kind="muted", wrap=True)
        self._picture = TravelPicture()
        left = column(
            label(lambda: self.tr("Table"), "section"),
            self._file,
            self._joints(),
            self._picture,
            self._axes(),
            None,
        )
        right = column(label(lambda: self.tr("Accuracy"), "section"), (self._accuracy(), 1))
        row((left, 1), (right, 1), on=self, spacing=3 * theme.GRID)
        draft.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def _joints(self) -> QWidget:
        """Travel, rate and acceleration of both joints, side by side."""
        headings: tuple[Words, ...] = (lambda: self.tr("Outer axis"), lambda: self.tr("Inner axis"))
        rows: tuple[tuple[str, str, Words], ...] = (
            ("low_deg", "°", lambda: self.tr("Lowest angle")),
            ("high_deg", "°", lambda: self.tr("Highest angle")),
            ("max_rate_dps", "°/s", lambda: self.tr("Largest rate")),
            ("max_acceleration_dps2", "°/s²", lambda: self.tr("Largest acceleration")),
        )
        made = QWidget()
        grid = QGridLayout(made)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(2 * theme.GRID)
        grid.setVerticalSpacing(theme.GRID // 2)
        for number, heading in enumerate(headings, start=1):
            title = label(heading)
            title.setFont(theme.font(bold=True))
            grid.addWidget(title, 0, number)
        for line, (key, unit, words) in enumerate(rows, start=1):
            caption = label(words)
            caption.setMinimumHeight(4 * theme.GRID)
            grid.addWidget(caption, line, 0, Qt.AlignmentFlag.AlignTop)
            for number, (joint, heading) in enumerate(zip(_JOINTS, headings, strict=True), start=1):
                field = Field(self._draft, (joint, key), NumberEdit(), str, unit=unit).hide_label(_NARROW)
                if key == "high_deg":
                    field.places += ((joint,),)  # a lowest angle above the highest is shown once
                bind(field.editor.setAccessibleName, partial(_joined, heading, words))
                self._fields.append(field)
                grid.addWidget(field, line, number, Qt.AlignmentFlag.AlignTop)
        grid.setColumnStretch(3, 1)
        return made

    def _axes(self) -> QWidget:
        outer = Field(self._draft, ("outer_axis",), VectorEdit(), lambda: self.tr("Outer axis in the body, at home"))
        outer.places += ((),)
        inner = Field(self._draft, ("inner_axis",), VectorEdit(), lambda: self.tr("Inner axis in the body, at home"))
        self._fields += [outer, inner]
        return Form(outer, inner)

    def _accuracy(self) -> QWidget:
        def number(key: str, unit: str, words: Words, hint: Words = str, default: Any = None) -> Field:
            place = ("accuracy", key)
            field = Field(self._draft, place, NumberEdit(), words, unit=unit, hint=hint, default=default)
            return field.set_width(_NARROW)

        fields = [
            number("encoder_sigma_deg", "°", lambda: self.tr("Encoder, sigma")),
            number("mount_sigma_deg", "°", lambda: self.tr("Mounting of the unit, sigma")),
            number("azimuth_sigma_deg", "°", lambda: self.tr("Azimuth of the site, sigma")),
            number("base_tilt_sigma_deg", "°", lambda: self.tr("Tilt of the base, sigma")),
            number(
                "velocity_sigma",
                "m/s",
                lambda: self.tr("Velocity, sigma"),
                lambda: self.tr("Of the velocity at rest and in known motion; larger on a vibrating floor."),
            ),
            number("velocity_interval_s", "s", lambda: self.tr("Interval of velocity observations")),
            number(
                "poll_latency_s",
                "s",
                lambda: self.tr("Latency of a polled angle"),
                lambda: self.tr("From the middle between request and answer."),
                0,
            ),
            number("poll_jitter_s", "s", lambda: self.tr("Jitter of the latency, sigma"), default=0),
        ]
        lever = Field(
            self._draft,
            ("outer_lever",),
            ChoiceBox(self._levers),
            lambda: self.tr("Lever arm from the centre"),
        ).set_width(26 * theme.GRID)
        self._fields += [*fields, lever]
        return Form(*fields, lever)

    def lock(self, reason: str) -> None:
        """Disable changes with the reason as tooltip; "" enables them."""
        for field in self._fields:
            field.lock(reason)

    def refresh(self) -> None:
        """Show the draft."""

        def angle(joint: str, key: str) -> float | None:
            value = self._draft.value((joint, key))
            return float(value) if isinstance(value, float | int) else None

        names = (self.tr("Outer"), self.tr("Inner"))
        self._picture.show_travel(
            [
                _Travel(name, angle(joint, "low_deg"), angle(joint, "high_deg"))
                for joint, name in zip(_JOINTS, names, strict=True)
            ]
        )
        self._file.setText(
            self.tr("From the table profile “{0}”. Changes hold for every station with this profile.").format(
                self._draft.name
            )
        )

    def _levers(self) -> list[tuple[Any, str]]:
        return [
            ("estimated", self.tr("found by the calibration")),
            ("fixed", self.tr("none: the unit turns about its centre")),
        ]


def _joined(heading: Words, words: Words) -> str:
    return f"{heading()}, {words()}"


@dataclass(frozen=True)
class _Travel:
    """A joint's name and travel in degrees; None for a missing or wrong number."""

    name: str
    low: float | None
    high: float | None

    @property
    def ends(self) -> tuple[float, float] | None:
        """Lowest and highest angle, None if they are not a range."""
        if self.low is None or self.high is None or self.low >= self.high:
            return None
        return self.low, self.high


class TravelPicture(QWidget):
    """The travel of both joints on one scale, with home at 0 and marks at whole parts of a turn."""

    def __init__(self) -> None:
        super().__init__()
        self._joints: list[_Travel] = []
        self.setMinimumHeight(_ROW * len(_JOINTS))
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def show_travel(self, joints: list[_Travel]) -> None:
        """Show the travel of these joints."""
        self._joints = joints
        self.setAccessibleName("; ".join(f"{joint.name}: {self._summary(joint)}" for joint in joints))
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw scale, bars and ends."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        ends = [abs(value) for joint in self._joints for value in joint.ends or ()]
        reach = (max(ends, default=0.0) or 180.0) * 1.08
        for number, joint in enumerate(self._joints):
            self._paint_joint(painter, joint, number * _ROW, reach)

    def _paint_joint(self, painter: QPainter, joint: _Travel, top: int, reach: float) -> None:
        c = theme.colours()
        left, right = _NAME + 2 * theme.GRID, self.width() - 3 * theme.GRID
        middle = top + 4 * theme.GRID

        def at(angle: float) -> float:
            return left + (right - left) * (angle + reach) / (2 * reach)

        painter.setFont(theme.font(bold=True))
        painter.setPen(QColor(c.text))
        painter.drawText(QRectF(0, middle - 14, _NAME, 28), Qt.AlignmentFlag.AlignVCenter, joint.name)
        painter.setFont(theme.font())
        painter.setPen(QPen(QColor(c.line), 1))
        painter.drawLine(left, middle, right, middle)
        step = next((tick for tick in _TICKS if 2 * reach / tick <= _MOST_TICKS), _TICKS[-1])
        for k in range(-math.floor(reach / step), math.floor(reach / step) + 1):
            x = int(at(k * step))
            painter.setPen(QPen(QColor(c.line if k else c.text), 1 if k else 2))
            painter.drawLine(x, middle - 14, x, middle + 14)
        if joint.ends is not None:
            low, high = joint.ends
            painter.fillRect(QRectF(at(low), middle - _BAR / 2, at(high) - at(low), _BAR), QColor(c.accent))
            painter.setPen(QPen(QColor(c.on_accent if low < 0 < high else c.text), 2))
            painter.drawLine(int(at(0)), middle - 6, int(at(0)), middle + 6)
            painter.setPen(QColor(c.text))
            for value in (low, high):
                box = QRectF(at(value) - 40, middle + 14, 80, 22)
                box.moveLeft(min(max(box.left(), _NAME), self.width() - box.width()))
                painter.drawText(box, Qt.AlignmentFlag.AlignCenter, f"{value:g}°".replace("-", "−"))
        painter.setPen(QColor(c.muted))
        above = QRectF(left, top, right - left, 2 * theme.GRID + 4)
        painter.drawText(above, Qt.AlignmentFlag.AlignCenter, self._summary(joint))

    def _summary(self, joint: _Travel) -> str:
        """How far the joint may turn altogether."""
        if joint.ends is None:
            return self.tr("no travel: the lowest angle must lie below the highest")
        span = joint.ends[1] - joint.ends[0]
        if span >= 720.0:
            return self.tr("{0:g} turns in all").format(round(span / 360.0, 2))
        return self.tr("{0:g}° in all").format(round(span, 3))
