"""Helpers that tests of every package share."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from calstation.errors import CalstationError
from calstation.schema import EntryError


@contextmanager
def raises_code(
    kind: type[CalstationError] | type[EntryError], code: str
) -> Iterator["pytest.ExceptionInfo[CalstationError | EntryError]"]:
    """Expect an error of a class with a code of the message catalogue; gives pytest's exception info."""
    with pytest.raises(kind) as caught:
        yield caught
    assert caught.value.code == code, f"{caught.value.code or 'no code'}: {caught.value}"


def complaint(error: CalstationError) -> str:
    """Entry and code of the first thing that a profile's loader complains about, e.g. ``link.baud entry.missing``."""
    what = error.values["what"]
    if what.code == "entry.at":
        return f"{what.values['field']} {what.values['what'].code}"
    return str(what.code)


class Progress:
    """A `ProgressCallback` that records."""

    def __init__(self) -> None:
        self.fractions: list[float] = []
        self.notes: list[str] = []

    def __call__(self, fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        self.fractions.append(fraction)
        self.notes.append(note)
