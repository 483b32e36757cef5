"""An example of a serial number that a product accepts."""

import re
import string
from collections.abc import Iterator
from itertools import cycle
from re import _parser  # type: ignore[attr-defined] # Python has no public parser of patterns
from typing import Any

#: Shown for every product that accepts it.
_USUAL = "SN-000123"

#: Characters that are tried where a pattern allows several, after a digit.
_CHARACTERS = string.ascii_uppercase + string.digits + string.printable

_CATEGORIES = {
    "CATEGORY_DIGIT": str.isdigit,
    "CATEGORY_WORD": lambda character: character.isalnum() or character == "_",
    "CATEGORY_SPACE": str.isspace,
}


def serial_example(pattern: str) -> str:
    """Return a serial number that matches a regular expression; "…" for one with conditions on its surroundings."""
    if re.fullmatch(pattern, _USUAL):
        return _USUAL
    example = "".join(_characters(_parser.parse(pattern), cycle("1234567890")))
    return example if re.fullmatch(pattern, example) else "…"


def _characters(parsed: Any, digits: Iterator[str]) -> Iterator[str]:
    """Yield characters that match a parsed pattern, with the fewest repetitions but at least one where allowed."""
    for code, value in parsed:
        match str(code):
            case "LITERAL":
                yield chr(value)
            case "ANY":
                yield next(digits)
            case "IN":
                tried = next(digits) + _CHARACTERS
                yield next(character for character in tried if _allowed(value, character))
            case "NOT_LITERAL":
                yield next(character for character in _CHARACTERS if ord(character) != value)
            case "SUBPATTERN":
                yield from _characters(value[-1], digits)
            case "BRANCH":
                yield from _characters(value[1][0], digits)
            case "MAX_REPEAT" | "MIN_REPEAT" | "POSSESSIVE_REPEAT":
                low, high, repeated = value
                for _ in range(max(low, min(high, 1))):
                    yield from _characters(repeated, digits)


def _allowed(items: Any, character: str) -> bool:
    """Whether a character is in a parsed set of characters."""
    negated, found = False, False
    for code, value in items:
        match str(code):
            case "NEGATE":
                negated = True
            case "LITERAL":
                found |= ord(character) == value
            case "RANGE":
                found |= value[0] <= ord(character) <= value[1]
            case "CATEGORY":
                name = str(value).replace("_NOT_", "_")
                found |= _CATEGORIES[name](character) != ("_NOT_" in str(value))
    return found != negated
