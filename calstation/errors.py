"""Errors shown to users: a catalogue code with values, and the exit code of the command line."""

from functools import partial
from typing import Any

from calstation.messages import Language, Rendered, Text, entry, os_reason, render


class CalstationError(Exception):
    """Base class of all errors shown to users: a code of the message catalogue, and the values of its sentences."""

    exit_code = 2

    def __init__(self, code: str, **values: Any) -> None:
        """Create an error. Raises KeyError for a code that is not in the catalogue."""
        super().__init__(code)
        self.code = entry(code).code
        self.values = values

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(type(self), self.code, **self.values), ()

    def __str__(self) -> str:
        return self.render().line

    @property
    def as_text(self) -> Text:
        """Code and values as a message, for use inside another message or for serialisation."""
        return Text(self.code, self.values)

    @property
    def resettable(self) -> bool:
        """Whether an operator may reset the fault on the device."""
        return entry(self.code).resettable

    def render(self, language: Language = "en", *, window: bool = False) -> Rendered:
        """Render source, text and remedy in a language."""
        return render(self.code, self.values, language, window=window)


class ConfigurationError(CalstationError):
    """A station, profile, product or command-line value is wrong (exit code 2)."""


def system_error(error: OSError) -> ConfigurationError | None:
    """Convert an operating-system error about a file; return None for an error that is not about a file."""
    if error.filename is None or error.errno is None:
        return None
    return ConfigurationError("program.file_unusable", file=error.filename, reason=os_reason(error))


class InputError(CalstationError):
    """A log or CSV file cannot be used (exit code 2)."""


class InsufficientDataError(InputError):
    """A stage has too little data (exit code 2)."""


class DeviceFaultError(CalstationError):
    """A device or its link failed (exit code 3)."""

    exit_code = 3


class StoppedError(CalstationError):
    """The operator stopped the run (exit code 4)."""

    exit_code = 4
