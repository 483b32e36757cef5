"""The errors that a person can meet: a catalogue code with values, and the exit code of the command line."""

from functools import partial
from typing import Any

from calstation.messages import Language, Rendered, Text, entry, render


class CalstationError(Exception):
    """Base of every error that a person reads: a code of the message catalogue, and the values of its sentences."""

    exit_code = 2

    def __init__(self, code: str, **values: Any) -> None:
        """Raise KeyError for a code that the catalogue lacks."""
        super().__init__(code)
        self.code = entry(code).code
        self.values = values

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(type(self), self.code, **self.values), ()

    def __str__(self) -> str:
        return self.render().line

    @property
    def as_text(self) -> Text:
        """Code and values, to stand inside another message or to travel."""
        return Text(self.code, self.values)

    @property
    def resettable(self) -> bool:
        """Whether an operator may reset the fault on the device."""
        return entry(self.code).resettable

    def render(self, language: Language = "en", *, window: bool = False) -> Rendered:
        """Source, text and remedy in a language."""
        return render(self.code, self.values, language, window=window)


class ConfigurationError(CalstationError):
    """A station, profile, product or command-line value is wrong (exit code 2)."""


class InputError(CalstationError):
    """A log or CSV cannot be used as it is (exit code 2)."""


class InsufficientDataError(InputError):
    """Too little data for a stage (exit code 2)."""


class DeviceFaultError(CalstationError):
    """A device or its link failed (exit code 3)."""

    exit_code = 3


class StoppedError(CalstationError):
    """The operator stopped the run (exit code 4)."""

    exit_code = 4
