"""What the table's profile says of its travel, its speeds, its axes and what its angles are worth."""

from typing import Any

from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from calstation.gui.settings.draft import Draft
from calstation.gui.settings.fields import Field, Form
from calstation.gui.settings.inputs import ChoiceBox, NumberEdit, VectorEdit
from calstation.gui.settings.travel import Travel, TravelPicture
from calstation.gui.widgets import theme

_JOINTS = ("outer", "inner")
_NARROW = 14 * theme.GRID


class TableSection(QWidget):
    """`[outer]`, `[inner]`, `[accuracy]` and the axes of the table profile's draft."""

    def __init__(self, draft: Draft) -> None:
        super().__init__()
        self._draft = draft
        self._heading, self._file, self._accuracy_heading = QLabel(), QLabel(), QLabel()
        for label in (self._heading, self._accuracy_heading):
            label.setProperty("kind", "section")
        self._file.setProperty("kind", "muted")
        self._file.setWordWrap(True)
        self._picture = TravelPicture()
        self._fields: list[Field] = []
        left = QVBoxLayout()
        left.setSpacing(theme.GRID)
        left.addWidget(self._heading)
        left.addWidget(self._file)
        left.addWidget(self._joints())
        left.addWidget(self._picture)
        left.addWidget(self._axes())
        left.addStretch(1)
        right = QVBoxLayout()
        right.setSpacing(theme.GRID)
        right.addWidget(self._accuracy_heading)
        right.addWidget(self._accuracy(), 1)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(3 * theme.GRID)
        row.addLayout(left, 1)
        row.addLayout(right, 1)
        draft.changed.connect(self.refresh)
        self.retranslate()

    def _joints(self) -> QWidget:
        """Travel, rate and acceleration of both axes, side by side."""
        panel = QWidget()
        grid = QGridLayout(panel)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(2 * theme.GRID)
        grid.setVerticalSpacing(theme.GRID // 2)
        self._corner = [QLabel() for _ in _JOINTS]
        for column, label in enumerate(self._corner):
            label.setFont(theme.font(bold=True))
            grid.addWidget(label, 0, column + 1)
        self._row_labels = [QLabel() for _ in range(4)]
        rows = (
            ("low_deg", "°"),
            ("high_deg", "°"),
            ("max_rate_dps", "°/s"),
            ("max_acceleration_dps2", "°/s²"),
        )
        for row, (key, unit) in enumerate(rows):
            self._row_labels[row].setMinimumHeight(4 * theme.GRID)
            grid.addWidget(self._row_labels[row], row + 1, 0, Qt.AlignmentFlag.AlignTop)
            for column, joint in enumerate(_JOINTS):
                # A lowest angle above the highest is told once, at the highest.
                also = ((joint,),) if key == "high_deg" else ()
                field = Field(
                    self._draft,
                    (joint, key),
                    NumberEdit(),
                    str,
                    unit=unit,
                    width=_NARROW,
                    bare=True,
                    also=also,
                )
                self._fields.append(field)
                grid.addWidget(field, row + 1, column + 1, Qt.AlignmentFlag.AlignTop)
        grid.setColumnStretch(3, 1)
        return panel

    def _axes(self) -> QWidget:
        self._axis_fields = [
            Field(
                self._draft,
                ("outer_axis",),
                VectorEdit(),
                lambda: self.tr("Outer axis in the body, at home"),
                also=((),),
            ),
            Field(
                self._draft, ("inner_axis",), VectorEdit(), lambda: self.tr("Inner axis in the body, at home")
            ),
        ]
        self._fields += self._axis_fields
        return Form(*self._axis_fields)

    def _accuracy(self) -> QWidget:
        def number(key: str, unit: str, words: Any, hint: Any = str, default: Any = None) -> Field:
            place = ("accuracy", key)
            return Field(
                self._draft, place, NumberEdit(), words, unit=unit, hint=hint, width=_NARROW, default=default
            )

        fields = [
            number("encoder_sigma_deg", "°", lambda: self.tr("Encoder, sigma")),
            number("mount_sigma_deg", "°", lambda: self.tr("Mounting of the unit, sigma")),
            number("azimuth_sigma_deg", "°", lambda: self.tr("Azimuth of the site, sigma")),
            number("base_tilt_sigma_deg", "°", lambda: self.tr("Tilt of the base, sigma")),
            number(
                "velocity_sigma",
                "m/s",
                lambda: self.tr("Velocity, sigma"),
                lambda: self.tr("What rest and known motion are worth; a shaking floor makes it larger."),
            ),
            number("velocity_interval_s", "s", lambda: self.tr("One such value every")),
            number(
                "poll_latency_s",
                "s",
                lambda: self.tr("Age of a polled angle"),
                lambda: self.tr("Beyond the middle between request and answer."),
                0,
            ),
            number("poll_jitter_s", "s", lambda: self.tr("Its scatter, sigma"), default=0),
        ]
        lever = Field(
            self._draft,
            ("outer_lever",),
            ChoiceBox(self._levers),
            lambda: self.tr("Lever arm from the centre"),
            width=26 * theme.GRID,
        )
        self._fields += [*fields, lever]
        return Form(*fields, lever)

    def lock(self, reason: str) -> None:
        """Forbid changes, with the reason as tooltip; "" allows them."""
        for field in self._fields:
            field.lock(reason)

    def refresh(self) -> None:
        """Show what the draft says."""

        def angle(joint: str, key: str) -> float | None:
            value = self._draft.value((joint, key))
            return float(value) if isinstance(value, float | int) else None

        names = (self.tr("Outer"), self.tr("Inner"))
        self._picture.show_travel(
            *(
                Travel(name, angle(joint, "low_deg"), angle(joint, "high_deg"))
                for joint, name in zip(_JOINTS, names, strict=True)
            )
        )
        self._file.setText(
            self.tr("From the table profile “{0}”. Changes hold for every station with this profile.").format(
                self._draft.name
            )
        )

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._heading.setText(self.tr("Table"))
        self._accuracy_heading.setText(self.tr("What its angles and its rest are worth"))
        for label, text in zip(self._corner, (self.tr("Outer axis"), self.tr("Inner axis")), strict=True):
            label.setText(text)
        texts = (
            self.tr("Lowest angle"),
            self.tr("Highest angle"),
            self.tr("Largest rate"),
            self.tr("Largest acceleration"),
        )
        for label, text in zip(self._row_labels, texts, strict=True):
            label.setText(text)
        for index, field in enumerate(self._fields[:8]):
            field.editor.setAccessibleName(f"{self._corner[index % 2].text()}, {texts[index // 2]}")
        self.refresh()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _levers(self) -> list[tuple[Any, str]]:
        return [
            ("estimated", self.tr("found by the calibration")),
            ("fixed", self.tr("none: the unit turns about its centre")),
        ]
