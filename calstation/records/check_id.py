"""The identity of a check, which consists of its kind and subject and determines its name in results and lists."""

import json
from typing import Literal, NamedTuple, get_args

#: Kind of a check. ``within`` and ``sigma_below`` apply to a parameter, ``consistency`` to a stage, ``previous`` to a
#: parameter or group; ``other`` is a check of another program version; the rest apply to the whole result.
CheckKind = Literal[
    "within",
    "sigma_below",
    "consistency",
    "unobservable",
    "latitude",
    "gravity_at_rest",
    "improvement_at_rest",
    "improvement_at_rest_floor",
    "level_horizontal",
    "level_vertical",
    "motion_angle",
    "motion_improvement",
    "motion_improvement_floor",
    "offline_online",
    "previous",
    "excitation",
    "change",
    "prior",
    "agreement",
    "halves",
    "effects",
    "alternatives",
    "table_noise",
    "imu_noise",
    "clipping",
    "samples",
    "sample_clock",
    "heading",
    "start_attitude",
    "temperature",
    "temperature_sensor",
    "temperature_fit",
    "hysteresis",
    "held_out",
    "convergence",
    "other",
]

#: Kinds of the model tests, each of which occurs once per stage. A failed test may cause later tests to fail.
MODEL_KINDS: tuple[CheckKind, ...] = (
    "clipping",
    "samples",
    "sample_clock",
    "temperature_sensor",
    "heading",
    "start_attitude",
    "convergence",
    "imu_noise",
    "effects",
    "alternatives",
    "halves",
    "agreement",
    "table_noise",
    "temperature_fit",
    "hysteresis",
    "held_out",
    "temperature",
)

#: Names that differ from the kind; the braces are replaced by the subject.
_NAMES: dict[CheckKind, str] = {
    "within": "{} within",
    "sigma_below": "{} sigma below",
    "consistency": "{} consistency",
    "unobservable": "unobservable parameters",
    "previous": "previous {}",
    "change": "change since calibration",
    "prior": "prior of the profile",
    **{kind: f"{{}} {kind.replace('_', ' ')}" for kind in MODEL_KINDS},
    "other": "{}",
}


class CheckId(NamedTuple):
    """The kind of a check and the parameter, group or stage to which it applies; "" for the whole result."""

    kind: CheckKind
    subject: str = ""

    @classmethod
    def of(cls, kind: str | None, subject: str, name: str) -> "CheckId":
        """Return the identity of a stored check; a kind that this version does not know becomes ``other``."""
        known_kind = next((each for each in get_args(CheckKind) if each == kind), None)
        return cls("other", name) if known_kind is None else cls(known_kind, subject)

    @property
    def name(self) -> str:
        """Name of the check in the result JSON and in lists of failed checks."""
        return _NAMES.get(self.kind, self.kind).format(self.subject)


def read_check_ids(text: str) -> tuple[CheckId, ...]:
    """Read checks from a JSON list of kinds and subjects."""
    return tuple(CheckId.of(kind, subject, subject) for kind, subject in json.loads(text))
