"""Texts of the outcome of a stored run and its decisions, used wherever they are displayed."""

from calstation.judgement import ParameterConformity
from calstation.messages import Text
from calstation.records import RunRecord, Verdict
from calstation.results.result import Result

#: Badges to which `partial` is not added.
_WHOLE = ("partial", "released", "missing", "altered", "unconfirmed")


def solved_offline(result: Result) -> Text | None:
    """Return the text that a result was solved offline, with the samples if only a part of its log was, or None."""
    if result.outcome != "resolved":
        return None
    if result.log.part:
        return Text.of("common.solved_offline_part", first=result.log.first_seq, last=result.log.last_seq)
    return Text("common.solved_offline")


def run_outcome(run: RunRecord | Result, *, stages: bool = False) -> Text:
    """Return the outcome of a stored run, such as ``FAIL (partial), simulated``, with its `stages` if it is partial."""
    outcome = Text(f"badge.{run.badge}")
    partial, names = run.partial and bool(run.stages), list(run.stages)
    if partial and stages and run.badge == Verdict.PARTIAL:
        outcome = Text.of("engineer.passed_stages", stages=names)
    elif partial and run.badge not in _WHOLE:
        values = {"stages": names} if stages else {}
        outcome = Text("engineer.partial_stages" if stages else "engineer.partial", {"outcome": run.badge, **values})
    return Text.of("history.outcome_simulated", outcome=outcome) if run.simulated else outcome


def value_decisions(result: Result) -> dict[str, ParameterConformity]:
    """Return the decisions on values that determine whether their parameters pass, unless a failed sigma does."""
    decided = {} if result.conformity is None else result.conformity.parameters
    failed = {check.subject for check in result.failed_checks}
    return {name: each for name, each in decided.items() if each.accepted != (name in failed)}
