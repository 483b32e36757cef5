"""Sentences of a link test in the language of the window."""

from calstation.gui.text import language
from calstation.messages import Finding, render, term


def word_finding(finding: Finding) -> tuple[str, str]:
    """What was found, and the remedy; the latter may be empty."""
    message = finding.message
    shown = render(message.code, message.values, language.current(), window=True)
    return shown.text, shown.remedy


def word_note(note: str) -> str:
    """What a running test does; empty for no note."""
    return term("note", note, language.current()) if note else ""
