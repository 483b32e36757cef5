"""One line of a validation: what was checked, the expectation, the finding and the conclusion."""

import logging
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Any, Literal

from calstation.errors import CalstationError, StoppedError
from calstation.messages import Text, os_reason

logger = logging.getLogger(__name__)

State = Literal["ok", "failed", "not_checked"]
Verdict = Literal["passed", "failed", "incomplete"]
#: Called often; raises StoppedError after Ctrl-C.
CheckStopped = Callable[[], None]
#: An expectation or a finding: a message, or a value that is the same in every language.
Content = Text | str

#: Areas of a validation in their order, each with the clause of ISO/IEC 17025:2017 that it addresses.
AREAS = {
    "installation": "7.11.2",
    "clock": "7.11.3 c",
    "disk": "7.11.3 b, d",
    "rights": "7.11.3 a, b",
    "calculation": "7.11.6",
    "faults": "7.11.3 e",
    "time": "7.11.2",
    "scope": "7.11.2",
}


@dataclass(frozen=True)
class Line:
    """One check and its result.

    check : name in the catalogue's family ``validation_check``
    subject : what was checked, such as the name of a package; with area and check it identifies the line
    reason : why something was not checked, or failed to be checked
    required : whether a validation is incomplete if this was not checked
    measured : whether `found` differs from one validation to the next without a change of the installation
    """

    area: str
    check: str
    subject: str
    expected: Content
    found: Content
    state: State
    reason: Text | None = None
    required: bool = True
    measured: bool = False

    def to_json(self) -> dict[str, Any]:
        """Return the line as JSON data."""
        data = {**vars(self), "clause": AREAS[self.area]}
        return {name: value.to_json() if isinstance(value, Text) else value for name, value in data.items()}

    @classmethod
    def compared(cls, area: str, check: str, subject: str, expected: Content, found: Content, good: bool) -> "Line":
        """Return the line of a check that was made."""
        return cls(area, check, subject, expected, found, "ok" if good else "failed")

    @classmethod
    def measurement(cls, area: str, check: str, subject: str, expected: Content, found: Content, good: bool) -> "Line":
        """Return the line of a check whose value varies."""
        return replace(cls.compared(area, check, subject, expected, found, good), measured=True)

    @classmethod
    def timed(cls, area: str, check: str, subject: str, seconds: float, limit: float) -> "Line":
        """Return the line of a duration, s, whose magnitude must not be above a limit."""
        expected = Text.of("validation.at_most_s", seconds=f"{limit:g}")
        return cls.measurement(area, check, subject, expected, f"{seconds:.3f} s", abs(seconds) <= limit)

    @classmethod
    def unchecked(
        cls, area: str, check: str, subject: str, expected: Content, reason: Text, *, required: bool = True
    ) -> "Line":
        """Return the line of something that could not be checked."""
        return cls(area, check, subject, expected, "", "not_checked", reason, required)


def verdict_of(lines: list[Line]) -> Verdict:
    """Return the verdict: failed with a failed line, otherwise incomplete if a required check was not made."""
    if any(line.state == "failed" for line in lines):
        return "failed"
    return "incomplete" if any(line.state == "not_checked" and line.required for line in lines) else "passed"


def guarded(area: str, check: str, subject: str, make: Callable[[], Generator[Line]]) -> Generator[Line]:
    """Yield the lines of a check; an error in it becomes a failed line with its reason."""
    try:
        yield from make()
    except StoppedError:
        raise
    except Exception as error:  # a damaged installation may raise anything
        logger.warning("%s %s %s: not completed", area, check, subject, exc_info=True)
        completed, failed = Text("validation.completed"), Text("validation.error")
        yield Line(area, check, subject, completed, failed, "failed", _reason(error))


def _reason(error: Exception) -> Text:
    if isinstance(error, CalstationError):
        return error.as_text
    if isinstance(error, OSError):
        return os_reason(error)
    return Text.of("os.other", words=f"{type(error).__name__}: {error}")
