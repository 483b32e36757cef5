"""Tests one device's link and shows, line by line, what was found and how to mend it."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from calstation.config import library
from calstation.config.station import DEFAULT_PRODUCT, StationConfig
from calstation.connection.link_test import LinkTestRequest, check_imu_link, check_table_link
from calstation.errors import CalstationError
from calstation.gui.settings.finding_wording import word_finding, word_note
from calstation.gui.settings.inputs import ChoiceBox
from calstation.gui.shell.context import AppContext
from calstation.gui.shell.reset_bar import ResetBar
from calstation.gui.text.messages import error_text
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import StateBadge, StateIcon
from calstation.gui.widgets.jobs import JobRow, JobWatch
from calstation.messages.finding import Finding, Report

_KINDS = {"ok": "good", "told": "none", "look": "caution", "wrong": "bad"}
#: Findings behind which the table is reset.
_LATCHED = ("fault", "fault_untold")


class _Line(QWidget):
    """One finding: shape, sentence, mend."""

    def __init__(self, finding: Finding) -> None:
        super().__init__()
        self._finding = finding
        icon = StateIcon(18)
        icon.set_kind(_KINDS[finding.state])
        self._text, self._mend = QLabel(), QLabel()
        for label in (self._text, self._mend):
            label.setWordWrap(True)
            label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._mend.setProperty("kind", "muted")
        words = QVBoxLayout()
        words.setSpacing(2)
        words.addWidget(self._text)
        words.addWidget(self._mend)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GRID)
        row.addWidget(icon, 0, Qt.AlignmentFlag.AlignTop)
        row.addLayout(words, 1)
        self.retranslate()

    def retranslate(self) -> None:
        """Say it again in the language in force."""
        text, mend = word_finding(self._finding)
        self._text.setText(text)
        self._mend.setText(mend)
        self._mend.setVisible(bool(mend))


class TestPanel(QFrame):
    """The test of ``table`` or ``imu`` as typed.

    Parameters
    ----------
    station : what is to be tested, None while the typed values are not right
    """

    __test__ = False  # no test of pytest's

    def __init__(self, app: AppContext, device: str, station: Callable[[], StationConfig | None]) -> None:
        super().__init__()
        self._app, self._device, self._station = app, device, station
        self.report: Report | None = None
        self._tested: tuple[object, ...] = ()
        self._error = ""
        self.setProperty("kind", "panel")
        self._title, self._about = QLabel(), QLabel()
        self._title.setProperty("kind", "section")
        self._about.setProperty("kind", "muted")
        self._about.setWordWrap(True)
        self.product_box = ChoiceBox(lambda: [(name, name) for name in library.names("products")])
        self.product_box.setObjectName("imu_test_product")
        self.product_box.typed.connect(self.refresh)
        self._product_label = QLabel()
        self._product_label.setBuddy(self.product_box)
        self.button = QPushButton()
        self.button.setObjectName(f"test_{device}_button")
        self.button.setProperty("kind", "primary")
        self.button.clicked.connect(self.start)
        self.watch = JobWatch(self)
        self.watch.progress.connect(self._progress)
        self.watch.done.connect(self._done)
        self.watch.failed.connect(self._failed)
        self.watch.cancelled.connect(self._cancelled)
        self._row = JobRow(self.watch)
        self._note = QLabel()
        self._note.setProperty("kind", "muted")
        self.badge = StateBadge(theme.SECTION)
        self.badge.setObjectName(f"{device}_test_badge")
        self.reset = ResetBar(app, self._order, f"{device}_reset_button")
        self.reset.changed.connect(self.refresh)
        self.reset.ended.connect(lambda _: self._test())
        self._why, self._nothing = QLabel(), QLabel()
        self._why.setWordWrap(True)
        self._nothing.setProperty("kind", "muted")
        self._nothing.setWordWrap(True)
        self._lines = QWidget()
        self._list = QVBoxLayout(self._lines)
        self._list.setContentsMargins(0, 0, theme.GRID, 0)
        self._list.setSpacing(theme.GRID)
        self._list.addStretch(1)
        self._lay_out()
        app.engine_link.running_changed.connect(lambda _: self.refresh())
        app.product_changed.connect(self._follow_product)
        self._follow_product()
        self._show_running(False)
        self.retranslate()

    def _lay_out(self) -> None:
        scroll = QScrollArea()
        scroll.setWidgetResizable(True)
        scroll.setFrameShape(QFrame.Shape.NoFrame)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setProperty("kind", "clear")
        scroll.setWidget(self._lines)
        choice = QHBoxLayout()
        choice.addWidget(self._product_label)
        choice.addWidget(self.product_box, 1)
        self._product_label.setVisible(self._device == "imu")
        self.product_box.setVisible(self._device == "imu")
        self.button.setSizePolicy(QSizePolicy.Policy.Maximum, QSizePolicy.Policy.Fixed)
        column = QVBoxLayout(self)
        column.setContentsMargins(2 * theme.GRID, 2 * theme.GRID, theme.GRID, theme.GRID)
        column.setSpacing(theme.GRID)
        column.addWidget(self._title)
        column.addWidget(self._about)
        column.addLayout(choice)
        column.addWidget(self.button)
        column.addWidget(self._row)
        column.addWidget(self._note)
        column.addWidget(self.badge)
        column.addWidget(self._why)
        column.addWidget(self.reset)
        column.addWidget(self._nothing)
        column.addWidget(scroll, 1)

    @property
    def product(self) -> Path:
        """The product whose IMU is expected."""
        return library.find("products", self.product_box.value())

    def start(self) -> None:
        """Test what is typed, saved or not."""
        self.reset.forget()
        self._test()

    def _test(self) -> None:
        """Test; what a reset before has said stays."""
        station = self._station()
        if station is None or self._app.engine_link.running or self.watch.busy or self.reset.watch.busy:
            return
        self._clear()
        work = check_table_link if self._device == "table" else check_imu_link
        self._tested = self._setting(station)
        self.watch.watch(self._app.job_queue.submit(work, LinkTestRequest(station, self.product)))
        self._show_running(True)

    def _order(self) -> LinkTestRequest | None:
        """What a press on the reset is for: what was tested, as typed."""
        station = self._station()
        return None if station is None else LinkTestRequest(station, self.product)

    def refresh(self) -> None:
        """Enable the button where a test may be made, and say why where not; forget what another setting gave."""
        station = self._station()
        told = self.report is not None or self.reset.result is not None
        if told and (station is None or self._setting(station) != self._tested):
            self.reset.forget()
            self._clear()
        reason = ""
        if self._app.engine_link.running:
            reason = self.tr("A run is going on; test when it has ended.")
        elif self.watch.busy:
            reason = self.tr("A test is going on.")
        elif self.reset.watch.busy:
            reason = self.tr("A fault is being reset.")
        elif station is None:
            reason = self.tr("Correct what is marked first.")
        self.button.setEnabled(not reason)
        self.button.setToolTip(reason)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._title.setText(self.tr("Connection test"))
        self._about.setText(
            self.tr(
                "Opens the link as typed, saved or not, asks who is there and listens. "
                "Nothing moves and no calibration is written."
            )
        )
        self._product_label.setText(self.tr("Expected: the IMU of product"))
        self.button.setText(self.tr("Test the table") if self._device == "table" else self.tr("Test the IMU"))
        for line in self._lines.findChildren(_Line):
            line.retranslate()
        self._nothing.setText(self.tr("Not tested as it is set now. What a test finds will stand here."))
        self._say_verdict()
        self.refresh()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _setting(self, station: StationConfig) -> tuple[object, ...]:
        """What a test depends on."""
        link = station.table if self._device == "table" else (station.imu, station.site, self.product)
        return (link, station.bench)

    def _follow_product(self) -> None:
        chosen = self._app.product_path
        self.product_box.show_value(chosen.stem if chosen is not None else DEFAULT_PRODUCT)

    def _progress(self, fraction: float, remaining: object) -> None:
        job = self.watch.job
        self._note.setText(word_note(job.note) if job is not None else "")

    def _done(self, report: Report) -> None:
        self.report = report
        for finding in report.findings:
            self._list.insertWidget(self._list.count() - 1, _Line(finding))
        self._show_running(False)
        # Last: the focus that the row of the job gives up must not land on it.
        self.reset.offer(self._device == "table" and any(map(report.find, _LATCHED)))

    def _failed(self, error: CalstationError) -> None:
        self._error = error_text(error).sentences
        self._show_running(False)

    def _cancelled(self) -> None:
        self._show_running(False)

    def _show_running(self, running: bool) -> None:
        self._row.setVisible(running)
        self._note.setVisible(running)
        self._say_verdict()
        self.refresh()

    def _say_verdict(self) -> None:
        state = "failed" if self._error else self.report.state if self.report is not None else ""
        words = {
            "ok": ("good", self.tr("The link works")),
            "look": ("caution", self.tr("The link works, but a run would not start like this")),
            "wrong": ("bad", self.tr("Not ready: mend what is marked")),
            "failed": ("bad", self.tr("The test could not be made")),
        }
        self.badge.setVisible(state in words and not self.watch.busy)
        if state in words:
            self.badge.show_state(*words[state])
        self._why.setText(self._error)
        self._why.setVisible(bool(self._error))
        self._nothing.setVisible(not state and not self.watch.busy)

    def _clear(self) -> None:
        self.report, self._error = None, ""
        self.reset.offer(False)
        for line in self._lines.findChildren(_Line):
            line.setParent(None)
            line.deleteLater()
        self._say_verdict()
