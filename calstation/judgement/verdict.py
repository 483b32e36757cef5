"""The verdict: made from a judgement and the way the run ended. The next action for a unit that did not pass."""

from enum import StrEnum

from calstation.config import ProductConfig
from calstation.records import Verdict


class End(StrEnum):
    """How a run ended; a log that was solved again is completed."""

    COMPLETED = "completed"
    STOPPED = "stopped"
    FAULT = "fault"
    INCOMPLETE = "incomplete"  #: Its process died.


def verdict_of(end: End, passed: bool | None, *, partial: bool) -> Verdict:
    """Return the verdict of a run, or of a log that was solved again.

    A run that was not completed has no other verdict than its end, whatever its values are.

    Parameters
    ----------
    end : how the run ended
    passed, partial : as in the judgement of its solutions
    """
    if end is not End.COMPLETED:
        return Verdict(end.value)
    if passed is None:
        return Verdict.UNDETERMINED
    if not passed:
        return Verdict.FAILED
    return Verdict.PARTIAL if partial else Verdict.PASSED


def advice(product: ProductConfig, verdict: Verdict, failures: int, *, resumable: bool) -> str | None:
    """Return the recommended action: ``reseat``, ``repeat``, ``set_aside`` or ``resume``; None for a unit that passed.

    `failures` counts consecutive failed runs, including this one.
    """
    if verdict.passed:
        return None
    if verdict is not Verdict.FAILED:
        return "resume" if resumable else "repeat"
    if product.attempts_allowed is not None and failures >= product.attempts_allowed:
        return "set_aside"
    return product.advice[min(failures, len(product.advice)) - 1]
