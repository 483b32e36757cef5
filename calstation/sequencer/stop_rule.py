"""When a repeated plan has done enough: a count, a duration, the operator's word, or sigmas below target."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from calstation.physics.arrays import FloatArray
from calstation.physics.parameters import INDEX, PARAMETERS


@dataclass(frozen=True)
class StopRule:
    """Ends a repeated plan at the first of its conditions that holds at the end of a round.

    Attributes
    ----------
    rounds : complete rounds, None for no such end
    duration : s of IMU time since the stage began, None for no such end
    targets : largest sigma wanted per parameter or group, SI; empty for no such end
    """

    rounds: int | None = None
    duration: float | None = None
    targets: Mapping[str, float] = field(default_factory=dict)

    def reason(self, rounds: int, elapsed: float, sigma: FloatArray | None, word: bool) -> str | None:
        """Why to stop now: operator, rounds, duration or targets; None to go on.

        `sigma` : standard deviations, shape (30,), SI, None where not known; `word` : the operator's.
        """
        if word:
            return "operator"
        if self.rounds is not None and rounds >= self.rounds:
            return "rounds"
        if self.duration is not None and elapsed >= self.duration:
            return "duration"
        if self.targets and sigma is not None and reached(sigma, self.targets):
            return "targets"
        return None


def reached(sigma: FloatArray, targets: Mapping[str, float]) -> bool:
    """Whether every chosen sigma (shape (30,), SI) lies below its target."""
    return all(sigma[i] <= limit for name, limit in targets.items() for i in named(name))


def named(name: str) -> list[int]:
    """Indices of a parameter, or of all parameters of a group; empty where there is none of that name."""
    if name in INDEX:
        return [INDEX[name]]
    return [i for i, p in enumerate(PARAMETERS) if p.group == name]
