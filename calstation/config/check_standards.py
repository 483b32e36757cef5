"""Check standards of a product: units with known values that stay at the station (golden units)."""

from pydantic import Field, field_validator

from calstation.physics import NAMES
from calstation.records import Day
from calstation.schema import EntryError, StrictModel, near_miss


class ReferenceSection(StrictModel):
    """`[check_standards.reference.NAME]`: reference value of a parameter and its standard deviation, SI."""

    value: float
    sigma: float = Field(ge=0)


class CheckStandardSection(StrictModel):
    """`[[check_standards]]` of a product: a unit that is calibrated regularly to check the station."""

    serial: str = Field(min_length=1)
    interval_days: float = Field(gt=0)  #: Longest time between two of its passed runs.
    #: Date on which the reference values were determined; without it, the unit is assumed to change only at a power-up.
    date: Day | None = None
    #: Reference by parameter; the outer lever belongs to the mounting and is not compared.
    reference: dict[str, ReferenceSection] = Field(min_length=1)

    @field_validator("reference")
    @classmethod
    def _known(cls, reference: dict[str, ReferenceSection]) -> dict[str, ReferenceSection]:
        for name in reference:
            if name not in NAMES:
                raise EntryError("entry.unknown_parameter", name, name=name, remedy=near_miss(name, NAMES))
        return reference
