"""Sentences about failed tests of the model."""

from calstation.messages import Text, values_from_json
from calstation.physics import EFFECTS, display, display_by_unit
from calstation.records import Check
from calstation.results.result import Result

#: Number of parameters that a sentence lists.
_MOST_MOVES = 3


def cause_text(check: Check) -> Text | None:
    """Return the message about the cause of a failed test of the model; None for any other check."""
    found = check.misfit
    if found is None:
        return None
    parameter = found.values.get("parameter", "")
    (size, unit), (sigma, _) = (
        display(parameter, value) if parameter else display_by_unit(found.unit, value)
        for value in (found.size, found.sigma)
    )
    worst = sorted(found.moves, key=lambda name: -abs(found.moves[name]))[:_MOST_MOVES]
    moves = ", ".join(f"{name} {found.moves[name]:+.0f} σ" for name in worst)
    shown = {"size": size, "sigma": sigma, "unit": unit, "moves": moves, "stage": check.subject}
    return Text(f"cause.{found.cause}", {**shown, **values_from_json(found.values)})


def missing_state(result: Result) -> Check | None:
    """Return the most significant failed check whose cause a further state of the model would describe, or None."""
    failed = [c for c in result.failed_checks if c.misfit is not None and c.misfit.cause in EFFECTS]
    return max(failed, key=lambda check: check.value, default=None)
