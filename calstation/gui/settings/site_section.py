"""The site of a station: latitude, longitude, height, azimuth and gravity."""

import math
from functools import partial
from typing import Any

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from calstation.config import StationConfig, confirmation_key, normal_gravity_at, site_advice, this_computer
from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import Field, Row, Section, panel
from calstation.gui.text import on_language_change, say
from calstation.gui.widgets import ChoiceBox, button, column, enable, label, row, theme
from calstation.schema import KeyPath, value_at

_NAMES = ("latitude_deg", "longitude_deg", "height_m", "azimuth_deg", "gravity_mps2", "gravity_sigma_mps2")
_AZIMUTH, _GRAVITY = ("site", "azimuth_deg"), ("site", "gravity_mps2")
_SURVEY: tuple[KeyPath, ...] = (_GRAVITY, ("site", "gravity_sigma_mps2"), ("site", "gravity_source"))
_CONFIRMED: KeyPath = ("site", "confirmed_on")
_COMPASS_SIZE = 26 * theme.GRID


class SiteSection(Section):
    """The section for the table `[site]` of a station file."""

    def __init__(self, draft: Draft) -> None:
        super().__init__(draft)
        azimuth_box = ChoiceBox(
            lambda: [(True, say("settings.given_here")), (False, say("settings.found_from_data"))], "azimuth_way_combo"
        )
        gravity_box = ChoiceBox(
            lambda: [(False, say("settings.normal_gravity")), (True, say("settings.surveyed"))],
            "gravity_way_combo",
        )
        for box, key_path in ((azimuth_box, _AZIMUTH), (gravity_box, _GRAVITY)):
            box.typed.connect(partial(self._choose, key_path))
        latitude, longitude, height, azimuth, gravity = (Field(draft, ("site", name)) for name in _NAMES[:-1])
        latitude.warning = lambda: self._warning_text("null_island", "azimuth_hopeless")
        gravity.warning = lambda: self._warning_text("gravity_off", *self._unless_bench("gravity_normal"))
        sigma, source = (Field(draft, key_path) for key_path in _SURVEY[1:])
        sigma.warning = lambda: self._warning_text(*self._unless_bench("gravity_sigma_small"))
        sigma.hint = lambda: say(f"setting.about_gravity_sigma_{'surveyed' if self._has(_GRAVITY) else 'normal'}")
        #: The choice, the fields shown if the value is given here, and the values that must then be entered.
        self._optional: dict[KeyPath, tuple[ChoiceBox, tuple[Field, ...], tuple[KeyPath, ...]]] = {
            _AZIMUTH: (azimuth_box, (azimuth,), (_AZIMUTH,)),
            _GRAVITY: (gravity_box, (gravity, source), _SURVEY),
        }
        self._confirmation = _Confirmation(draft, self)
        left = column(
            label("settings.site", "section"),
            latitude,
            longitude,
            height,
            Row(azimuth_box, "azimuth_of_body"),
            azimuth,
            Row(gravity_box, "gravity"),
            gravity,
            sigma,
            source,
            self._confirmation,
            None,
        )
        row(left, (self._make_panel(), 1), on=self, spacing=3 * theme.GRID)
        self.connect_draft()

    def _make_panel(self) -> QWidget:
        self._compass, self._compass_note = _Compass(), label(kind="muted", wrap=True)
        self._normal = label(kind="section", name="normal_gravity_label")
        return panel(
            label("settings.normal_gravity_tip", "muted", wrap=True),
            self._normal,
            label("setting.about_normal_gravity", "muted", wrap=True),
            2 * theme.GRID,
            (self._compass, 0, Qt.AlignmentFlag.AlignHCenter),
            self._compass_note,
        )

    def lock(self, reason: str) -> None:
        """Disable changes and show `reason` in tooltips; "" enables them."""
        super().lock(reason)
        enable(self._confirmation.button, reason)

    def refresh(self) -> None:
        """Show the values of the draft and the quantities derived from them."""
        for key_path, (box, fields, typed) in self._optional.items():
            value = self._draft.value(key_path)
            # a value that was deleted in its field must be entered again, unless the other choice is selected
            if self._draft.differs(key_path) and (value is not None or fields[0].editor.hasFocus()):
                self._draft.require(typed)
            has_value = self._has(key_path)
            box.show_value(has_value)
            for field in fields:
                field.setVisible(has_value)
        latitude, _, height, azimuth, *_ = self._values()
        self._compass.show_azimuth(float(azimuth) if isinstance(azimuth, float | int) else None)
        self._compass_note.setText(say("settings.azimuth_tip" if azimuth is not None else "settings.about_azimuth"))
        normal = normal_gravity_at(latitude, height)
        self._normal.setText(f"{normal:.5f} m/s²" if normal is not None else "–")

    def _values(self) -> list[Any]:
        return [self._draft.value(("site", name)) for name in _NAMES]

    def _has(self, key_path: KeyPath) -> bool:
        """Return whether an optional value is given or must still be entered."""
        return self._draft.value(key_path) is not None or self._draft.requires(key_path)

    def _unless_bench(self, *ids: str) -> tuple[str, ...]:
        """Return these ids of findings; none for a bench, which simulates the gravity of its station."""
        return () if self._draft.value(("bench",)) is not None else ids

    def _choose(self, key_path: KeyPath) -> None:
        """Remove an optional value, or require that the user enters it unless the station file contains it."""
        box, fields, typed = self._optional[key_path]
        fields[0].editor.clearFocus()
        given = bool(box.value())
        stored = given and value_at(self._draft.stored, key_path) is not None
        self._draft.require(typed, given and not stored)
        self._draft.set({each: value_at(self._draft.stored, each) if stored else None for each in typed})

    def _warning_text(self, *ids: str) -> str:
        """Return the message of the first of these findings that applies to the values, or ""."""
        return next((say(finding.message) for finding in site_advice(*self._values()) if finding.id in ids), "")


class _Confirmation(QWidget):
    """A list of the computers on which the site was confirmed, and a button to confirm it; hidden for a bench."""

    def __init__(self, draft: Draft, parent: QWidget) -> None:
        super().__init__(parent)
        self._draft = draft
        self._text = label(name="site_confirmed_on_message", wrap=True)
        self.button = button("confirm_place_button", "settings.confirm_site", self._confirm)
        column(self._text, (self.button, 0, Qt.AlignmentFlag.AlignLeft), on=self, margins=(0, theme.GRID, 0, 0))
        draft.changed.connect(self._show)
        on_language_change(self, self._show)

    def _show(self) -> None:
        self.setVisible(self._draft.value(("bench",)) is None)
        confirmed, key = self._confirmed(), self._key()
        self.button.setVisible(bool(key) and key not in confirmed)
        state = "confirmed" if key in confirmed else "differs" if confirmed else "unconfirmed"
        self._text.setText(say(f"setting.site_{state}", here=this_computer(), confirmed="; ".join(confirmed)))
        theme.set_kind(self._text, "caution" if state == "differs" else "muted")

    def _confirmed(self) -> list[str]:
        value = self._draft.value(_CONFIRMED)
        return [str(name) for name in value] if isinstance(value, list) else []

    def _key(self) -> str:
        """Return the confirmation key for this computer, or "" while the file is invalid."""
        station = self._draft.model
        return confirmation_key(station.site) if isinstance(station, StationConfig) else ""

    def _confirm(self) -> None:
        here = f"{this_computer()}: "
        others = [key for key in self._confirmed() if not key.startswith(here)]
        self._draft.set({_CONFIRMED: [*others, self._key()]})


class _Compass(QWidget):
    """A compass with north at the top and an arrow along body +y, or a question mark if the azimuth is unknown."""

    def __init__(self) -> None:
        super().__init__()
        self._azimuth: float | None = None
        self.setFixedSize(QSize(_COMPASS_SIZE, _COMPASS_SIZE))

    def show_azimuth(self, azimuth: float | None) -> None:
        """Show an azimuth in degrees, or None if it is unknown."""
        self._azimuth = azimuth
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the compass rose and the arrow."""
        c = theme.colours()
        painter = theme.painter(self)
        painter.translate(self.width() / 2, self.height() / 2)
        radius = self.width() / 2 - 3 * theme.GRID
        painter.setPen(QPen(QColor(c.line), 2))
        painter.drawEllipse(QPointF(0, 0), radius, radius)
        for step in range(36):
            length = 10 if step % 9 == 0 else 5
            painter.drawLine(_polar(radius - length, 10 * step), _polar(radius, 10 * step))
        painter.setFont(theme.font(bold=True))
        painter.setPen(QColor(c.muted))
        for angle, letter in ((0, "N"), (90, "E"), (180, "S"), (270, "W")):
            at = _polar(radius + 12, angle)
            painter.drawText(QRectF(at.x() - 12, at.y() - 12, 24, 24), Qt.AlignmentFlag.AlignCenter, letter)
        if self._azimuth is None:
            painter.setFont(theme.font(theme.SECTION, bold=True))
            painter.drawText(QRectF(-20, -20, 40, 40), Qt.AlignmentFlag.AlignCenter, "?")
            return
        colour = QColor(theme.AXIS_COLOURS["y"])
        painter.rotate(self._azimuth)
        painter.setPen(QPen(colour, 3))
        tip = -(radius - 16)
        painter.drawLine(QPointF(0, 0), QPointF(0, tip + 8))
        painter.setBrush(colour)
        painter.drawPolygon(QPolygonF([QPointF(0, tip), QPointF(-7, tip + 14), QPointF(7, tip + 14)]))
        painter.drawEllipse(QPointF(0, 0), 4, 4)
        painter.translate(16, tip + 18)
        painter.rotate(-self._azimuth)
        painter.setPen(QColor(c.text))
        painter.drawText(QRectF(-14, -12, 28, 24), Qt.AlignmentFlag.AlignCenter, "+y")


def _polar(radius: float, angle: float) -> QPointF:
    """Return the point at a radius and an angle, degrees clockwise from north."""
    return QPointF(radius * math.sin(math.radians(angle)), -radius * math.cos(math.radians(angle)))
