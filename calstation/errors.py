"""The errors that a person can meet: a catalogue code with values, and the exit code of the command line."""

from typing import Any

from calstation.messages import Language, Rendered, Text, entry, known, render


class CalstationError(Exception):
    """Base of every error that a person reads.

    Parameters
    ----------
    code : its entry in the message catalogue, ``table.no_answer``
    values : what stands in the braces of the entry's sentences
    """

    exit_code = 2

    def __init__(self, code: str, **values: Any) -> None:
        super().__init__(code)
        self.code = code if known(code) else ""
        self.values = values

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), self.args[0], self.values)

    def __str__(self) -> str:
        return self.render().line if self.code else str(self.args[0])

    @property
    def family(self) -> str:
        """Family of its code, such as ``motion``; "" without one."""
        return self.code.partition(".")[0]

    @property
    def as_text(self) -> Text:
        """Code and values, to stand inside another message or to travel."""
        return Text(self.code, self.values) if self.code else Text.of("os.other", words=str(self))

    @property
    def resettable(self) -> bool:
        """Whether an operator may reset the fault on the device."""
        return bool(self.code) and entry(self.code).resettable

    def render(self, language: Language = "en", *, window: bool = False) -> Rendered:
        """Source, text and remedy in a language."""
        if not self.code:
            return Rendered("", str(self.args[0]), "")
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


def _rebuild(kind: type[CalstationError], code: str, values: dict[str, Any]) -> CalstationError:
    return kind(code, **values)
