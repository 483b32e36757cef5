"""A stage's solution as events."""

from calstation.estimation.method import Solution
from calstation.physics.parameters import INDEX
from calstation.sequencer.events import Message, StageSolved


def told(solution: Solution) -> tuple[StageSolved | Message, ...]:
    """What a listener is told of a solution: its values, then the solver's remarks."""
    sigma, consistency = solution.belief.sigma, solution.consistency
    parameters = {
        name: {"value": float(solution.belief.mean[INDEX[name]]), "sigma": float(sigma[INDEX[name]])}
        for name in solution.estimated
    }
    parameters |= {name: {"value": e.value, "sigma": e.sigma} for name, e in solution.found.items()}
    innovations = {
        "nis_mean": consistency.nis_mean,
        "nis_low": consistency.nis_low,
        "nis_high": consistency.nis_high,
        "passed": consistency.passed,
        "warning": consistency.warning,
    }
    remarks = [Message(message_id, dict(values)) for message_id, values in solution.messages]
    return StageSolved(solution.stage, parameters, innovations), *remarks
