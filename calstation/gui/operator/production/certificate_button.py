"""The button that issues the calibration certificate of a result."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QPushButton

from calstation.config import ConfirmationRequired, Person, computer_user
from calstation.gui.shell import AppContext, PeoplePanel
from calstation.gui.text import bind
from calstation.gui.widgets import Choice, JobWatch, NoticeBar
from calstation.reports import certificate_required, issue_certificate
from calstation.results import Result


class CertificateButton(QPushButton):
    """Visible for a result with parameters; the notice bar shows the certificate or why there is none.

    The owner lays out `panel`, which asks for two people where the product requires them. `then` is called after the
    notice has been closed.
    """

    def __init__(self, app: AppContext, name: str, notice: NoticeBar, then: Callable[[], None]) -> None:
        super().__init__()
        self.setObjectName(name)
        self._app, self._notice, self._then = app, notice, then
        self._result_file: Path | None = None
        self.panel = PeoplePanel(name)
        self._asking, self.watch = JobWatch(self, self._begin), JobWatch(self, self._issued)
        for watch in (self._asking, self.watch):
            notice.report_failures(watch, lambda: self.tr("No certificate was issued"), then)
            watch.busy_changed.connect(self._show_busy)
        self.watch.progress.connect(lambda *_: self._show_busy())
        self.clicked.connect(self._ask)
        bind(self, self._text)
        self.hide()

    def offer(self, result: Result | None, result_file: Path | None) -> None:
        """Offer the certificate of a result."""
        if result_file != self._result_file:
            self.panel.hide()
        self._result_file = result_file
        self.setVisible(result is not None and result_file is not None and bool(result.parameters))

    def _text(self) -> str:
        job = self.watch.job
        if job is None:
            return self.tr("Certificate")
        return self.tr("Certificate, {0:.0f} %").format(100 * job.fraction)

    def _show_busy(self) -> None:
        self.setEnabled(not (self._asking.busy or self.watch.busy))
        self.setText(self._text())

    def _ask(self) -> None:
        self._asking.watch(self._app.job_queue.submit(certificate_required, self._result_file))

    def _begin(self, required: ConfirmationRequired) -> None:
        app = self._app
        by = (app.badge if required.badge else app.operator or computer_user()) or ""
        if required.second:
            self.panel.ask(lambda: self.tr("Issue a certificate?"), required, self._issue, by=by, reason=False)
        else:
            self._issue("", Person(by or computer_user() or "-"), None)

    def _issue(self, _: str, first: Person, second: Person | None) -> None:
        self.panel.hide()
        work = issue_certificate, self._result_file, self._app.station_path, first, second
        self.watch.watch(self._app.job_queue.submit(*work))

    def _issued(self, pdf: Path) -> None:
        self._notice.ask(
            "good",
            lambda: self.tr("The certificate was issued"),
            lambda: str(pdf),
            (
                Choice("certificate_close_button", lambda: self.tr("Close"), self._then),
                Choice("certificate_open_button", lambda: self.tr("Open"), lambda: self._open(pdf), primary=True),
            ),
        )

    def _open(self, pdf: Path) -> None:
        QDesktopServices.openUrl(QUrl.fromLocalFile(str(pdf)))
