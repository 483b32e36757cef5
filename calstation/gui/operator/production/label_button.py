"""Button that prints the label of a passed unit."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QPushButton

from calstation.errors import CalstationError
from calstation.gui.state import AppContext
from calstation.gui.text import bind
from calstation.gui.widgets import NoticeBar
from calstation.reports import label_template, print_label
from calstation.results import Result


class LabelButton(QPushButton):
    """Visible for a passed run of a product with a label; the notice bar shows whether it was printed.

    `then` is called after a label has been printed, or after its notice has been closed.
    """

    def __init__(self, app: AppContext, name: str, notice: NoticeBar, then: Callable[[], None]) -> None:
        super().__init__()
        self.setObjectName(name)
        self._app, self._notice, self._then = app, notice, then
        self._result_file: Path | None = None
        self._watch = app.job(self, print_label, self._printed)
        notice.report_failures(self._watch, "operator.label_not_printed", then)
        self._watch.busy_changed.connect(lambda: self.setEnabled(not self._watch.busy))
        self.clicked.connect(self._print)
        bind(self, "operator.print_label")
        self.hide()

    def offer(self, result: Result | None, result_file: Path | None) -> None:
        """Offer the label of a run if it has one."""
        self._result_file = result_file
        try:
            template = None if result is None or result_file is None else label_template(result)
        except CalstationError:  # an unreadable product is reported on the operator page
            template = None
        self.setVisible(template is not None)

    def _print(self) -> None:
        self._watch.start(self._result_file, self._app.station_path)

    def _printed(self, pdf: Path | None) -> None:
        if pdf is None:
            self._notice.ask("good", "operator.label_printed", "")
        else:
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(pdf)))
            self._notice.inform("good", "operator.label_saved", lambda: str(pdf), self._then)
        self._then()
