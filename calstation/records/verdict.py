"""The verdict about a unit, as results, logs and the index of runs store it."""

from enum import StrEnum


class Verdict(StrEnum):
    """Verdict of a run, or of the solution of its log; only `calstation.judgement.verdict_of` determines it."""

    PASSED = "passed"  #: Within all limits, after all stages of the product.
    PARTIAL = "partial"  #: Within the limits of the stages that were run; other stages of the product are missing.
    FAILED = "failed"  #: Outside a limit, or a check standard that differs from its reference.
    UNDETERMINED = "undetermined"  #: Without limits, without tests of data and model, or with data missing.
    STOPPED = "stopped"  #: The run was stopped.
    FAULT = "fault"  #: A fault ended the run, for example a wrong output after the registers were written.
    INCOMPLETE = "incomplete"  #: The process of the run died.

    @property
    def passed(self) -> bool | None:
        """Whether the unit is within its limits, as in the result JSON; None if that is undetermined."""
        return None if self is Verdict.UNDETERMINED else self in (Verdict.PASSED, Verdict.PARTIAL)

    @property
    def judged(self) -> bool:
        """Whether the run was completed, so that its values were compared with the limits."""
        return self not in (Verdict.STOPPED, Verdict.FAULT, Verdict.INCOMPLETE)

    @property
    def outcome(self) -> str:
        """The `outcome` of a run in the result JSON, in which a partial run that passed has `passed`."""
        return "passed" if self is Verdict.PARTIAL else self.value
