"""How a job gets on, in one row: a bar, the time left, and Cancel where it may be given up."""

from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import QHBoxLayout, QLabel, QProgressBar, QPushButton, QWidget

from calstation.gui.text.wording import word_time
from calstation.gui.widgets import theme
from calstation.gui.widgets.job_watch import JobWatch

_STEPS = 1000
#: Fraction from which the time left is worth saying.
_FIRM = 0.05


class JobRow(QWidget):
    """Follows one `JobWatch`."""

    def __init__(self, watch: JobWatch, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._watch = watch
        self._fraction = 0.0
        self._remaining: float | None = None
        self.bar = QProgressBar()
        self.bar.setRange(0, _STEPS)
        self.bar.setTextVisible(False)
        self.bar.setFixedHeight(2 * theme.GRID)
        self.left_label = QLabel()
        self.left_label.setMinimumWidth(15 * theme.GRID)
        self.left_label.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self.cancel_button = QPushButton()
        self.cancel_button.clicked.connect(watch.cancel)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GRID)
        row.addWidget(self.bar, 1)
        row.addWidget(self.left_label)
        row.addWidget(self.cancel_button)
        watch.progress.connect(self._show)
        self.retranslate()

    def retranslate(self) -> None:
        """Say it again in the language in force."""
        self.cancel_button.setText(self.tr("Cancel"))
        self._say()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _show(self, fraction: float, remaining: float | None) -> None:
        self._fraction, self._remaining = fraction, remaining
        self._say()

    def _say(self) -> None:
        job = self._watch.job
        self.cancel_button.setVisible(job is None or job.cancellable)
        self.bar.setValue(round(_STEPS * self._fraction))
        percent = f"{100 * self._fraction:.0f} %"
        if job is not None and job.state == "waiting":
            self.left_label.setText(self.tr("waiting for other work"))
        elif self._remaining is None or self._fraction < _FIRM:
            self.left_label.setText(percent)
        else:
            left = self.tr("{0} left").format(word_time(self._remaining))
            self.left_label.setText(f"{percent}, {left}")
        self.bar.setAccessibleName(self.left_label.text())
