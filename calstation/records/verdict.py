"""The verdict on a unit, as stored in results, logs and the index of runs."""

from enum import StrEnum


class Verdict(StrEnum):
    """Verdict of a run, or of the solution of its log; only `calstation.judgement.verdict_of` determines it."""

    PASSED = "passed"  #: The unit is within all limits after all stages of the product.
    PARTIAL = "partial"  #: The unit is within the limits of the stages that were run, but other stages are missing.
    FAILED = "failed"  #: The unit is outside a limit, or a check standard differs from its reference.
    UNDETERMINED = "undetermined"  #: There are no limits or no tests of data and model, or data are missing.
    STOPPED = "stopped"  #: The run was stopped.
    FAULT = "fault"  #: A fault ended the run, for example a wrong output after the registers were written.
    INCOMPLETE = "incomplete"  #: The process of the run ended before the run.

    @property
    def passed(self) -> bool | None:
        """Whether the unit is within its limits, as in the result JSON; None if this is undetermined."""
        return None if self is Verdict.UNDETERMINED else self in (Verdict.PASSED, Verdict.PARTIAL)

    @property
    def judged(self) -> bool:
        """Whether the run was completed, so that its values were compared with the limits."""
        return self not in (Verdict.STOPPED, Verdict.FAULT, Verdict.INCOMPLETE)

    @property
    def outcome(self) -> str:
        """The `outcome` of a run in the result JSON, which is `passed` for a partial run that passed."""
        return "passed" if self is Verdict.PARTIAL else self.value
