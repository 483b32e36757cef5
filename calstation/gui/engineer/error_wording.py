"""An error of a device or a configuration in one line, in the language in force where its sentence is known."""

from calstation.gui.fault_wording import word_fault


def one_line(text: str) -> str:
    """Cause, what is wrong and the mend of an error's own words."""
    words = word_fault("", text)
    return " ".join(part for part in (words.reason, words.mend) if part)
