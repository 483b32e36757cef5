"""Texts of the catalogue in the language of the command line."""

from calstation.messages import Language, Text, Value, rendering

#: Language of the command line.
LANGUAGE: Language = "en"


def say(code: str, **values: Value) -> str:
    """Return the sentences of a catalogue entry."""
    return rendering.render(code, values, LANGUAGE).sentences


def sentence(message: Text) -> str:
    """Return a message, with its source at the start, on one line."""
    return rendering.sentence(message, LANGUAGE)


def term(family: str, name: str, **values: Value) -> str:
    """Return a term of a catalogue family, such as the stage ``rate``."""
    return rendering.term(family, name, LANGUAGE, **values)
