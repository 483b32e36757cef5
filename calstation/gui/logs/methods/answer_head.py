"""What an answer comes down to, in a line above its views: verdict, unit, length, and the solver's remarks."""

from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QVBoxLayout, QWidget

from calstation.gui.text import duration_text, event_sentence
from calstation.gui.widgets import StateBadge, theme
from calstation.results.plots import MethodAnswer


class AnswerHead(QWidget):
    """Hidden while there is no answer."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._answer: MethodAnswer | None = None
        self.badge, self._about, self._remarks = StateBadge(theme.BODY), QLabel(), QLabel()
        self._about.setProperty("kind", "muted")
        self._remarks.setProperty("kind", "caution")
        self._remarks.setWordWrap(True)
        line = QHBoxLayout()
        line.setSpacing(2 * theme.GRID)
        line.addWidget(self.badge)
        line.addWidget(self._about, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID)
        column.addLayout(line)
        column.addWidget(self._remarks)

    def show_answer(self, answer: MethodAnswer | None) -> None:
        """Show an answer, or none."""
        self._answer = answer
        self.setVisible(answer is not None)
        self.retranslate()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        answer = self._answer
        if answer is None:
            return
        remarks = "\n".join(event_sentence(key, values) for key, values in answer.resolved.messages)
        self._remarks.setText(remarks)
        self._remarks.setVisible(bool(remarks))
        self.badge.show_state(*self._verdict(answer))
        result, recording = answer.resolved.result, answer.recording
        about = [
            recording.serial,
            self.tr("{0} at {1:g} Hz").format(duration_text(recording.duration), recording.rate),
        ]
        lost = result.unobservable
        if lost:
            about.append(self.tr("not determined: {0} of {1}").format(len(lost), len(result.parameters)))
        self._about.setText("  ·  ".join(about))

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _verdict(self, answer: MethodAnswer) -> tuple[str, str]:
        """Shape and words of what the checks say."""
        result = answer.resolved.result
        failed = len(result.failed_checks)
        near = sum(check.near_miss for check in result.checks)
        if failed:
            said = self.tr("{0} of {1} checks failed").format(failed, len(result.checks))
            return "bad" if result.passed is False else "caution", said
        if result.passed is None:
            return "good", self.tr("Solved; the recording names no limits")
        if near:
            return "caution", self.tr("Passed, {0} near-misses").format(near)
        return "good", self.tr("Inside every limit")
