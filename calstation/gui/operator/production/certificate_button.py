"""The button that issues the calibration certificate of a result."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QPushButton

from calstation.gui.shell import AppContext
from calstation.gui.text import bind
from calstation.gui.widgets import Choice, JobWatch, NoticeBar
from calstation.reports import issue_certificate
from calstation.results import Result


class CertificateButton(QPushButton):
    """Visible for a result with parameters; the notice bar shows the certificate or why there is none.

    `then` is called after the notice has been closed.
    """

    def __init__(self, app: AppContext, name: str, notice: NoticeBar, then: Callable[[], None]) -> None:
        super().__init__()
        self.setObjectName(name)
        self._app, self._notice, self._then = app, notice, then
        self._result_file: Path | None = None
        self.watch = JobWatch(self, self._issued)
        notice.report_failures(self.watch, lambda: self.tr("No certificate was issued"), then)
        self.watch.busy_changed.connect(self._show_busy)
        self.watch.progress.connect(lambda *_: self._show_busy())
        self.clicked.connect(self._issue)
        bind(self, self._text)
        self.hide()

    def offer(self, result: Result | None, result_file: Path | None) -> None:
        """Offer the certificate of a result."""
        self._result_file = result_file
        self.setVisible(result is not None and result_file is not None and bool(result.parameters))

    def _text(self) -> str:
        job = self.watch.job
        if job is None:
            return self.tr("Certificate")
        return self.tr("Certificate, {0:.0f} %").format(100 * job.fraction)

    def _show_busy(self) -> None:
        self.setEnabled(not self.watch.busy)
        self.setText(self._text())

    def _issue(self) -> None:
        app = self._app
        self.watch.watch(app.job_queue.submit(issue_certificate, self._result_file, app.station_path))

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
