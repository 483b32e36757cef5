"""A check: a quantity of a result, its unit, its limit, and whether it is within the limit."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from calstation.estimation import Diagnosis, ModelTest
from calstation.messages import Text
from calstation.physics import INDEX, PARAMETERS
from calstation.records import MODEL_KINDS, NEAR_MISS_FRACTION, CheckId, CheckKind


@dataclass(frozen=True)
class Where:
    """Origin of the worst value of a check: a parameter, a rest of a stage, or the motions between two rests."""

    parameter: str = ""  #: Name of the parameter, or "".
    stage: str = ""  #: Stage of the rests, or "".
    rest: int | None = None  #: Number of the rest, from 0.
    to: int | None = None  #: Number of the rest after the motions.

    @property
    def number(self) -> str:
        """The displayed number of the rest, from 1; "" without a rest."""
        return "" if self.rest is None else str(self.rest + 1)

    @property
    def rests(self) -> Text | None:
        """The text about the rest or rests, numbered from 1; None without a rest."""
        if self.rest is None:
            return None
        number = self.rest + 1
        if self.to is None:
            return Text.of("check.rest", number=number)
        return Text.of("check.rests", number=number, to=self.to + 1)

    def __str__(self) -> str:
        """Return the text used in the result JSON."""
        if self.rest is None:
            return self.parameter
        return f"{self.stage} rest {self.rest}" + ("" if self.to is None else f" to {self.to}")

    def to_json(self) -> dict[str, str | int]:
        """Return the fields that are set."""
        return {name: value for name, value in vars(self).items() if value not in ("", None)}


@dataclass(frozen=True)
class Check:
    """A comparison of a value with a limit."""

    kind: CheckKind
    subject: str  #: Parameter, group or stage that is checked; "" for a check of the whole result.
    value: float  #: Compared value, in `unit`; NaN if unknown.
    limit: float | tuple[float, float]  #: Largest value, or (lowest, highest); infinite if unknown.
    unit: str
    passed: bool
    near_miss: bool = False  #: Whether the value is within the limit with little margin.
    where: Where = Where()  #: Origin of the value.
    diagnosis: Diagnosis | None = None  #: Diagnosis of a failed model test.
    #: Lowest and highest accepted value if the decision rule narrows the limit.
    acceptance: tuple[float, float] | None = None

    @classmethod
    def of_model(cls, stage: str, test: ModelTest) -> "Check":
        """Return the check for a test of the model against the data of a stage."""
        kind = next(kind for kind in MODEL_KINDS if kind == test.kind)
        check = cls.compare(kind, test.value, test.limit, test.unit, subject=stage, near=1.0)
        return check if check.passed else replace(check, diagnosis=test.diagnosis)

    @classmethod
    def compare(
        cls,
        kind: CheckKind,
        value: float,
        limit: float | tuple[float, float],
        unit: str,
        *,
        subject: str = "",
        near: float = NEAR_MISS_FRACTION,
        where: Where | None = None,
        acceptance: tuple[float, float] | None = None,
    ) -> "Check":
        """Compare a value with its limit, or with `acceptance` if the decision rule narrows the limit.

        A value within the limit, but above its fraction `near`, is a near miss.

        Parameters
        ----------
        kind : kind of the check
        value : value, in `unit`
        limit : upper limit, or lower and upper limit, in `unit`
        unit : unit of value and limits
        subject : name of the parameter or quantity
        near : fraction of the limit above which a value is a near miss
        where : rest, motion or parameter to which the value belongs
        acceptance : lower and upper limit narrowed by the decision rule, in `unit`
        """
        accepted = acceptance or limit
        low, high = accepted if isinstance(accepted, tuple) else (-math.inf, accepted)
        passed = bool(low <= value <= high)
        width = 0.5 * (high - low) if isinstance(accepted, tuple) else abs(accepted)
        near_miss = bool(passed and 0.0 < width < math.inf and _margin(value, accepted) < (1.0 - near) * width)
        return cls(kind, subject, value, limit, unit, passed, near_miss, where or Where(), acceptance=acceptance)

    @property
    def id(self) -> CheckId:
        """Kind and subject."""
        return CheckId(self.kind, self.subject)

    @property
    def name(self) -> str:
        """Name in the result JSON."""
        return self.id.name

    @property
    def code(self) -> str:
        """Code of the sentence that states what the check requires."""
        return f"check.{self.kind}{'_guarded' if self.acceptance is not None else ''}"

    @property
    def compared_with(self) -> float | tuple[float, float]:
        """The limit, or the acceptance limits if the decision rule narrows it."""
        return self.acceptance or self.limit

    @property
    def margin(self) -> float:
        """Distance of the value from `compared_with`, in `unit`; negative if exceeded."""
        return _margin(self.value, self.compared_with)

    @property
    def parameter(self) -> str:
        """Name of the parameter at `where` if the value has the unit of this parameter, otherwise ""."""
        name = self.where.parameter
        return name if name in INDEX and PARAMETERS[INDEX[name]].unit == self.unit else ""

    @property
    def cause_text(self) -> Text | None:
        """Message about the cause of a failed model test; None for any other check."""
        return None if self.diagnosis is None else self.diagnosis.text(self.subject)

    def to_json(self) -> dict[str, Any]:
        """Return the check as a row of the result JSON."""
        row = {
            "name": self.name,
            "kind": self.kind,
            "subject": self.subject,
            "value": self.value,
            "limit": list(self.limit) if isinstance(self.limit, tuple) else self.limit,
            "unit": self.unit,
            "passed": self.passed,
            "margin": self.margin,
            "near_miss": self.near_miss,
        }
        if where := self.where.to_json():
            row |= {"where": str(self.where), "at": where}
        if self.acceptance is not None:
            row["acceptance"] = list(self.acceptance)
        if self.diagnosis is not None:
            row |= self.diagnosis.to_json()
        return row

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> "Check":
        """Read a check from a result JSON."""
        kind, subject = CheckId.of(row.get("kind"), row.get("subject", ""), row["name"])
        limit, acceptance = row["limit"], row.get("acceptance")
        return cls(
            kind,
            subject,
            math.nan if row["value"] is None else row["value"],
            (limit[0], limit[1]) if isinstance(limit, list) else math.inf if limit is None else limit,
            row["unit"],
            bool(row["passed"]),
            bool(row.get("near_miss")),
            Where(**row.get("at", {})),
            Diagnosis.from_json(row) if "cause" in row else None,
            None if acceptance is None else (acceptance[0], acceptance[1]),
        )


def _margin(value: float, limit: float | tuple[float, float]) -> float:
    if isinstance(limit, tuple):
        return min(value - limit[0], limit[1] - value)
    return limit - value


def short_names(checks: Sequence[Check | CheckId]) -> list[Text]:
    """Return the short names of checks; names that occur more than once include the stage."""
    names = [Text.of(f"check_short.{check.kind}", parameter=check.subject, stage=check.subject) for check in checks]
    counts = Counter(map(str, names))
    return [
        name if counts[str(name)] == 1 else Text.of("common.check_of_stage", check=name, stage=check.subject)
        for name, check in zip(names, checks, strict=True)
    ]
