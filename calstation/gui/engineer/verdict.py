"""The verdict of a result as a word and a shape; a partial calibration is never shown as a PASS."""

from calstation.gui.text import KINDS, say, term
from calstation.results import Result


def verdict_text(result: Result, *, stages: bool = True) -> str:
    """Return the verdict of a run, such as ``PASS``; for a partial run, with its `stages` unless they are False."""
    if result.released or not result.partial or not result.stages:
        return term("badge", result.badge)
    passed = result.verdict == "partial"
    if not stages:
        return term("badge", "partial") if passed else say("engineer.partial", outcome=result.outcome)
    code = "engineer.passed_stages" if passed else "engineer.partial_stages"
    return say(code, outcome=result.outcome, stages=result.stages)


def verdict_badge(result: Result) -> tuple[str, str]:
    """Return the shape (`widgets.badge.KINDS`) and the text of the verdict of a run, or of a re-solved log."""
    if result.outcome != "resolved":
        return KINDS.get(result.verdict, "none"), verdict_text(result)
    kind = {None: "none", True: "partial" if result.partial else "good", False: "bad"}[result.passed]
    return kind, say(f"engineer.resolved_{kind if result.tested else 'untested'}")
