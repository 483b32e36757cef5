"""Two IMUs or more at rest and in motion: the check against thresholds, the watch, what is kept, what is left."""

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from PySide6.QtCore import QEvent, QSignalBlocker, Signal
from PySide6.QtWidgets import QComboBox, QFrame, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from calstation.gui.logs.methods.figures import Figure, three_digits
from calstation.gui.logs.methods.pair_parts import (
    SENSORS,
    CheckBar,
    CheckBars,
    Timeline,
    shown,
    why_given_up,
    word_schedule,
    word_sensor,
)
from calstation.gui.logs.methods.plots import MethodPlot
from calstation.gui.text import on_language_change
from calstation.gui.widgets import theme
from calstation.physics import DEGREE, display, number, pair_name
from calstation.results import PairCheckResult, PairProgress
from calstation.results.plots import (
    MethodAnswer,
    PairPlotData,
    PairResiduals,
    SecondaryPlotData,
    StoredPairFile,
)

#: What is left is drawn in °/s and m/s²: it is mostly that of motion.
_RATE, _FORCE = DEGREE, 1.0


class PairCheckView(QWidget):
    """The check at rest, the watch and what is kept. `check_wanted()`: the button was pressed."""

    check_wanted = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._answer: MethodAnswer | None = None
        self._checked: PairCheckResult | None = None
        self.schedule_label, self._why, self._kept = QLabel(), QLabel(), QLabel()
        self.schedule_label.setWordWrap(True)
        self._why.setWordWrap(True)
        self._why.setProperty("kind", "caution")
        self._kept.setWordWrap(True)
        self._kept.setObjectName("pair_kept_label")
        self._heads = QLabel(), QLabel(), QLabel()
        for head in self._heads:
            head.setProperty("kind", "section")
        self.bars, self.timeline = CheckBars(), Timeline()
        self.check_button = QPushButton()
        self.check_button.setObjectName("check_button")
        self.check_button.clicked.connect(self.check_wanted)
        panel = QFrame()
        panel.setProperty("kind", "panel")
        inside = QVBoxLayout(panel)
        inside.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID)
        inside.setSpacing(theme.GRID)
        inside.addWidget(self._heads[0])
        inside.addWidget(self.bars)
        watch = QFrame()
        watch.setProperty("kind", "panel")
        below = QVBoxLayout(watch)
        below.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID)
        below.setSpacing(theme.GRID)
        top = QHBoxLayout()
        top.addWidget(self._heads[1])
        top.addStretch(1)
        top.addWidget(self.check_button)
        self._unwatched = QLabel()
        self._unwatched.setProperty("kind", "muted")
        self._unwatched.setWordWrap(True)
        below.addLayout(top)
        below.addWidget(self._unwatched)
        below.addWidget(self.timeline)
        below.addWidget(self._why)
        kept = QHBoxLayout()
        kept.setSpacing(2 * theme.GRID)
        kept.addWidget(self._heads[2])
        kept.addWidget(self._kept, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, theme.GRID, 0, 0)
        column.setSpacing(theme.GRID)
        column.addWidget(self.schedule_label)
        column.addWidget(panel)
        column.addWidget(watch)
        column.addLayout(kept)
        column.addStretch(1)
        on_language_change(self, self.retranslate)

    def show_answer(self, answer: MethodAnswer) -> None:
        """Show what a solved recording says at rest, and what its triggers led to where it has any."""
        self._answer, self._checked = answer, None
        picture = answer.picture
        assert isinstance(picture, PairPlotData)
        end = PairProgress(picture.duration, picture.duration, "waiting", 0.0, picture.happened)
        self.timeline.show_followed(end if picture.happened else None)
        self.retranslate()

    def show_followed(self, followed: PairProgress | None) -> None:
        """How far the watch has come."""
        self.timeline.show_followed(followed)
        self._show_watch(followed)

    def show_checked(self, checked: PairCheckResult) -> None:
        """The watch has come to its end."""
        self._checked = checked
        self.timeline.show_followed(checked.followed)
        self.retranslate()

    @property
    def kept(self) -> tuple[StoredPairFile, ...]:
        """What is kept of the pairs at hand."""
        if self._checked is not None:
            return self._checked.kept
        picture = None if self._answer is None else self._answer.picture
        return picture.kept if isinstance(picture, PairPlotData) else ()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        texts = self.tr("Check at rest"), self.tr("Watch"), self.tr("Kept")
        for head, text in zip(self._heads, texts, strict=True):
            head.setText(text)
        self.check_button.setText(self.tr("Check now"))
        self.check_button.setToolTip(
            self.tr("Follows the recording as if it were live: what is off is calibrated and kept")
        )
        self._unwatched.setText(
            self.tr(
                "Check now follows this recording as it would be followed live: a check at the first rest, and "
                "for what is off a calibration from the motion after it."
            )
        )
        if self._answer is not None:
            self.schedule_label.setText(word_schedule(self._answer.schedule))
            self.bars.show_bars(self._bars())
        self._kept.setText("\n".join(self._word_kept(kept) for kept in self.kept))
        self._show_watch(self.timeline.followed)

    def _show_watch(self, followed: PairProgress | None) -> None:
        self._unwatched.setVisible(followed is None)
        self.timeline.setVisible(followed is not None)
        why = "" if followed is None else why_given_up(followed)
        self._why.setText(self.tr("Given up: {0}").format(why) if why else "")
        self._why.setVisible(bool(why))

    def _bars(self) -> list[CheckBar]:
        assert self._answer is not None
        picture = self._answer.picture
        assert isinstance(picture, PairPlotData)
        bars: list[CheckBar] = []
        by_trigger = {h.number for h in picture.happened if h.kind == "calibrated"}
        for place, secondary in enumerate(picture.secondaries):
            check: Mapping[str, Any] | None = secondary.check
            calibrated: Mapping[str, float | None] = {}
            if secondary.number in by_trigger:
                calibrated = secondary.static
            if self._checked is not None:
                check, calibrated = self._checked.checks.get(secondary.number, check), {}
                if secondary.number in self._checked.calibrated:
                    calibrated = self._checked.kept[place].static
            name = self.tr("IMU {0}").format(secondary.number)
            for sensor in SENSORS:
                bars.append(self._bar(name, sensor, check and check["secondary"][sensor], calibrated.get(sensor)))
            if place == len(picture.secondaries) - 1:
                for sensor in SENSORS:
                    bars.append(self._bar(self.tr("primary"), sensor, check and check["primary"][sensor], None))
        return bars

    def _bar(self, unit: str, sensor: str, told: Mapping[str, Any] | None, calibrated: float | None) -> CheckBar:
        name = f"{unit}  {word_sensor(sensor)}"
        if told is None:
            return CheckBar(name, 0.0, "–", "", self.tr("no rest to check at"), "none")
        within = bool(told["within"])
        verdict, state = (self.tr("within"), "good") if within else (self.tr("off"), "bad")
        if not within and calibrated is not None:
            now = shown(sensor, calibrated)
            good = calibrated <= told["limit"]
            verdict = (self.tr("calibrated: now {0}") if good else self.tr("calibrated, still {0}")).format(now)
            state = "good" if good else "caution"
        return CheckBar(
            name,
            told["value"] / told["limit"],
            shown(sensor, told["value"]),
            self.tr("at most {0}").format(shown(sensor, told["limit"])),
            verdict,
            state,
        )

    def _word_kept(self, kept: StoredPairFile) -> str:
        if not kept.utc:
            return self.tr("IMU {0}, {1}: nothing is kept of it yet.").format(kept.number, kept.serial)
        when = datetime.fromisoformat(kept.utc).astimezone().strftime("%Y-%m-%d %H:%M")
        return self.tr("IMU {0}, {1}: calibrated last on {2}, {3} values in {4}").format(
            kept.number, kept.serial, when, kept.values, kept.file
        )


class PairLeftView(QWidget):
    """What is left between secondary and primary over the recording, and where the secondary sits in space and time."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._answer: MethodAnswer | None = None
        self._calibrated: list[SecondaryPlotData] = []
        self.figures = [Figure() for _ in range(4)]
        self.gyro_plot, self.accel_plot = MethodPlot(log=True), MethodPlot(log=True)
        self.accel_plot.setXLink(self.gyro_plot)
        self.secondary_combo = QComboBox()
        self.secondary_combo.setObjectName("secondary_combo")
        self.secondary_combo.currentIndexChanged.connect(lambda _: self.retranslate())
        row = QHBoxLayout()
        row.setSpacing(3 * theme.GRID)
        for figure in self.figures:
            figure.number.setFont(theme.font(theme.SECTION, bold=True))
            row.addWidget(figure)
        row.addStretch(1)
        row.addWidget(self.secondary_combo)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, theme.GRID, 0, 0)
        column.setSpacing(theme.GRID)
        column.addLayout(row)
        column.addWidget(self.gyro_plot, 1)
        column.addWidget(self.accel_plot, 1)

    def show_answer(self, answer: MethodAnswer) -> None:
        """Draw it, the first secondary that was calibrated; the others can be chosen."""
        self._answer = answer
        picture = answer.picture
        assert isinstance(picture, PairPlotData)
        self._calibrated = [s for s in picture.secondaries if s.left]
        with QSignalBlocker(self.secondary_combo):
            self.secondary_combo.clear()
            self.secondary_combo.addItems([f"{s.number}: {s.serial}" for s in self._calibrated])
        self.secondary_combo.setVisible(len(self._calibrated) > 1)
        self.retranslate()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        answer = self._answer
        if answer is None:
            return
        self.secondary_combo.setAccessibleName(self.tr("Secondary shown"))
        index = max(self.secondary_combo.currentIndex(), 0)
        of = self._calibrated[index] if self._calibrated else None
        for plot in (self.gyro_plot, self.accel_plot):
            plot.empty()
        if of is None:
            for figure in self.figures:
                figure.show_text("", "")
            self.gyro_plot.say([(self.tr("Nothing was calibrated in this recording"), theme.colours().muted)])
            return
        name = self.tr("IMU {0}").format(of.number)
        self._draw(self.gyro_plot, of.left["gyro"], self.tr("{0} gyro against the primary, °/s").format(name), _RATE)
        self._draw(
            self.accel_plot,
            of.left["accel"],
            self.tr("{0} accelerometer against the primary, m/s²").format(name),
            _FORCE,
        )
        gyro, accel, clock, lever = self.figures
        (before, after), (force, left) = of.left["gyro"].rms, of.left["accel"].rms
        gyro.show_change(self.tr("gyro left, rms"), before / _RATE, after / _RATE, "°/s")
        accel.show_change(self.tr("accelerometer left, rms"), force / _FORCE, left / _FORCE, "m/s²")
        clock.show_text(self.tr("clock offset"), self._told(answer, ["clock_offset"], of.number))
        levers = [f"secondary_lever_{axis}" for axis in "xyz"]
        lever.show_text(self.tr("lever arm x, y, z"), self._told(answer, levers, of.number))

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language or theme."""
        if event.type() in (QEvent.Type.LanguageChange, QEvent.Type.PaletteChange):
            self.retranslate()
        super().changeEvent(event)

    def _draw(self, plot: MethodPlot, left: PairResiduals, title: str, size: float) -> None:
        c = theme.colours()
        plot.line(left.time, left.before / size, c.caution)
        plot.line(left.time, left.after / size, c.accent)
        plot.say(
            [
                (title, c.text),
                (self.tr("before"), c.caution),
                (self.tr("after"), c.accent),
                (self.tr("s from the start"), c.muted),
            ]
        )
        plot.fit()

    def _told(self, answer: MethodAnswer, names: list[str], imu: int) -> str:
        """Values with the unit people read; a dash where they were not fitted."""
        rows = [(name, answer.parameters.get(pair_name(name, imu))) for name in names]
        texts, unit = [], ""
        for name, row in rows:
            if row is None:
                return "–"
            value, unit = display(name, row.value)
            texts.append(three_digits(value))
            if len(rows) == 1:
                sigma = display(name, row.sigma)[0]
                texts[-1] = f"{number(value, sigma)} ± {number(sigma, sigma)}".replace("-", "−")
        return f"{', '.join(texts)} {unit}"
