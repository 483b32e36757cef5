"""Where the table stands: latitude, longitude, height, azimuth, gravity, each with what it would cost to be wrong."""

from typing import Any

from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from calstation.config import site_advice
from calstation.gui.settings.compass import Compass
from calstation.gui.settings.confirmation import PlaceConfirmation
from calstation.gui.settings.draft import Draft
from calstation.gui.settings.fields import Field, Form, Row, at_top, tab_through
from calstation.gui.settings.inputs import ChoiceBox, NumberEdit
from calstation.gui.widgets import theme

_AZIMUTH, _GRAVITY = ("site", "azimuth_deg"), ("site", "gravity_mps2")
#: Gravity, m/s², that stands in the input until the surveyed one is typed: no place has it, so nothing runs with it.
_NOWHERE = 9.7
_NAMES = ("latitude_deg", "longitude_deg", "height_m", "azimuth_deg", "gravity_mps2")


class SiteSection(QWidget):
    """`[site]` of a station's draft."""

    def __init__(self, draft: Draft) -> None:
        super().__init__()
        self._draft = draft
        self._last: dict[tuple[str, str], Any] = {_AZIMUTH: 0.0}
        self._heading = QLabel()
        self._heading.setProperty("kind", "section")
        self.azimuth_box = ChoiceBox(self._azimuth_ways)
        self.azimuth_box.setObjectName("azimuth_way_combo")
        self.azimuth_box.typed.connect(lambda: self._choose(_AZIMUTH, self.azimuth_box.value()))
        self.gravity_box = ChoiceBox(self._gravity_ways)
        self.gravity_box.setObjectName("gravity_way_combo")
        self.gravity_box.typed.connect(lambda: self._choose(_GRAVITY, self.gravity_box.value()))
        self._azimuth_row = Row(self.azimuth_box, lambda: self.tr("Azimuth of body +y at home"))
        self._gravity_row = Row(self.gravity_box, lambda: self.tr("Gravity"))
        self._fields = {
            "latitude_deg": Field(
                draft,
                ("site", "latitude_deg"),
                NumberEdit(),
                lambda: self.tr("Latitude"),
                unit="°",
                hint=lambda: self.tr(
                    "North positive. Wrong by 1°: up to 0.19 °/h of gyro bias, 92 ppm of gravity."
                ),
            ),
            "longitude_deg": Field(
                draft,
                ("site", "longitude_deg"),
                NumberEdit(),
                lambda: self.tr("Longitude"),
                unit="°",
                hint=lambda: self.tr("East positive."),
            ),
            "height_m": Field(
                draft,
                ("site", "height_m"),
                NumberEdit(),
                lambda: self.tr("Height above the ellipsoid"),
                unit="m",
                hint=lambda: self.tr("Wrong by 10 m: 3 ppm of gravity."),
            ),
            "azimuth_deg": Field(draft, _AZIMUTH, NumberEdit(), str, unit="°", hint=self._about_azimuth),
            "gravity_mps2": Field(draft, _GRAVITY, NumberEdit(), str, unit="m/s²", hint=self._about_gravity),
        }
        self.confirmation = PlaceConfirmation(draft)
        f = self._fields
        self._form = Form(
            f["latitude_deg"],
            f["longitude_deg"],
            f["height_m"],
            self._azimuth_row,
            f["azimuth_deg"],
            self._gravity_row,
            f["gravity_mps2"],
            self.confirmation,
        )
        tab_through(
            *(f[name].editor for name in ("latitude_deg", "longitude_deg", "height_m")),
            self.azimuth_box,
            f["azimuth_deg"].editor,
            self.gravity_box,
            f["gravity_mps2"].editor,
            self.confirmation.button,
        )
        f["gravity_mps2"].advise(self._gravity_advice)
        f["latitude_deg"].advise(self._place_advice)
        left = QVBoxLayout()
        left.setSpacing(theme.GRID)
        left.addWidget(self._heading)
        left.addWidget(self._form, 1)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(3 * theme.GRID)
        row.addLayout(left)
        row.addWidget(at_top(self._picture()), 1)
        draft.changed.connect(self.refresh)
        self.retranslate()

    def _picture(self) -> QWidget:
        panel = QFrame()
        panel.setProperty("kind", "panel")
        self._compass = Compass()
        self._compass_words, self._normal_title, self.normal_label, self._gravity_words = (
            QLabel(),
            QLabel(),
            QLabel(),
            QLabel(),
        )
        self.normal_label.setObjectName("normal_gravity_label")
        self.normal_label.setProperty("kind", "section")
        for label in (self._compass_words, self._normal_title, self._gravity_words):
            label.setProperty("kind", "muted")
            label.setWordWrap(True)
        column = QVBoxLayout(panel)
        column.setContentsMargins(2 * theme.GRID, 2 * theme.GRID, 2 * theme.GRID, 2 * theme.GRID)
        column.setSpacing(theme.GRID)
        column.addWidget(self._normal_title)
        column.addWidget(self.normal_label)
        column.addWidget(self._gravity_words)
        column.addSpacing(2 * theme.GRID)
        column.addWidget(self._compass, 0, Qt.AlignmentFlag.AlignHCenter)
        column.addWidget(self._compass_words)
        column.addStretch(1)
        return panel

    def lock(self, reason: str) -> None:
        """Forbid changes, with the reason as tooltip; "" allows them."""
        self._form.lock(reason)
        self.confirmation.lock(reason)
        for box in (self.azimuth_box, self.gravity_box):
            box.setEnabled(not reason)
            box.setToolTip(reason)

    def refresh(self) -> None:
        """Show what the draft says, and what follows from it."""
        for place, box in ((_AZIMUTH, self.azimuth_box), (_GRAVITY, self.gravity_box)):
            value = self._draft.value(place)
            if value is not None:
                self._last[place] = value
            # A value that is just being typed anew is empty for a moment: its input stays.
            own = value is not None or self._fields[place[1]].editor.hasFocus()
            box.show_value(own)
            self._fields[place[1]].setVisible(own)
        azimuth = self._draft.value(_AZIMUTH)
        self._compass.show_azimuth(float(azimuth) if isinstance(azimuth, float | int) else None)
        self._compass_words.setText(
            self.tr("Body +y at home, seen from above.")
            if azimuth is not None
            else self.tr(
                "The azimuth is found from the data: levelling and gyrocompassing at the first rest."
            )
        )
        normal = self._normal()
        self.normal_label.setText(f"{normal:.5f} m/s²" if normal is not None else "–")

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._heading.setText(self.tr("Site"))
        self._normal_title.setText(self.tr("Normal gravity at this latitude and height (WGS-84)"))
        self._gravity_words.setText(
            self.tr(
                "True gravity differs from it by 50 ppm as a rule. All three accelerometer scale factors carry any "
                "error of gravity one to one: give a surveyed value where ppm matter. Units whose gyros do not feel "
                "the earth turn are not calibrated without one: nothing else would show a wrong latitude."
            )
        )
        for box in (self.azimuth_box, self.gravity_box):
            box.fill()
        self.refresh()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _choose(self, place: tuple[str, str], given: bool) -> None:
        """Give a value of one's own, beginning with the last one; or none."""
        value = None
        self._fields[place[1]].editor.clearFocus()
        if given:
            value = self._last.get(place, _NOWHERE if place == _GRAVITY else 0.0)
        self._draft.set({place: value})

    def _normal(self) -> float | None:
        return site_advice.normal(
            self._draft.value(("site", "latitude_deg")), self._draft.value(("site", "height_m"))
        )

    def _advice(self) -> dict[str, Any]:
        given = (self._draft.value(("site", name)) for name in _NAMES)
        return {found.id: found.values for found in site_advice.advice(*given)}

    def _gravity_advice(self) -> str:
        off = self._advice().get("gravity_off")
        if off is None:
            return ""
        return self.tr(
            "{percent:+.2f} % from normal gravity: no run starts with it. All three accelerometer scale factors "
            "would be off by {ppm:+.0f} ppm."
        ).format(**off)

    def _place_advice(self) -> str:
        advice = self._advice()
        if "null_island" in advice:
            return self.tr("Latitude and longitude are both 0: hardly meant.")
        if "azimuth_hopeless" in advice:
            return self.tr("So near a pole no azimuth can be found from the data; give it below.")
        return ""

    def _about_azimuth(self) -> str:
        given = self._draft.value(_AZIMUTH) is not None
        return self.tr("Clockwise from true north.") if given else self.tr("Empty: found from the data.")

    def _about_gravity(self) -> str:
        return "" if self._draft.value(_GRAVITY) is not None else self.tr("Empty: normal gravity.")

    def _azimuth_ways(self) -> list[tuple[Any, str]]:
        return [(True, self.tr("given here")), (False, self.tr("found from the data"))]

    def _gravity_ways(self) -> list[tuple[Any, str]]:
        return [(False, self.tr("normal gravity, computed")), (True, self.tr("surveyed, given here"))]
