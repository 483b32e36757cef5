"""What a connection test found, in the language in force."""

from PySide6.QtCore import QCoreApplication

from calstation.messages import finding_words
from calstation.messages.finding import Finding


def word_finding(finding: Finding) -> tuple[str, str]:
    """What was found, and the mend ("" where there is nothing to mend)."""
    return finding_words.word_finding(finding, _say)


def word_note(note: str) -> str:
    """What a running test is doing."""
    return finding_words.word_note(note, _say)


def _say(text: str) -> str:
    return QCoreApplication.translate("station_finding", text)
