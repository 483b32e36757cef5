"""Laboratory and instruments of a certificate. They are stored in the log, so that result and log suffice."""

from datetime import date
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainSerializer

from calstation.schema import EntryError, StrictModel


def _as_date(value: Any) -> date:
    """Return a date of a TOML file unchanged, and parse the text of a date in a stored log."""
    if isinstance(value, date):
        return value
    try:
        return date.fromisoformat(value)
    except (TypeError, ValueError):
        raise EntryError("entry.not_a_date", value=value) from None


_Text = Annotated[str, Field(min_length=1)]
#: A date, which is ISO 8601 text in a log.
Day = Annotated[date, BeforeValidator(_as_date), PlainSerializer(date.isoformat)]


class LaboratorySection(StrictModel):
    """`[laboratory]`: the laboratory, the place, the customer, and the persons who authorise the certificate."""

    name: _Text
    address: _Text
    country: Annotated[str, Field(pattern="^[A-Z]{2}$")] | None = None  #: ISO 3166-1 code, such as CN.
    place: _Text | None = None  #: Place of the calibration, if not at `address`.
    accreditation: _Text | None = None  #: Accreditation body and number.
    customer: _Text | None = None
    customer_address: _Text | None = None
    signatories: list[_Text] = Field(default_factory=list)  #: Each "Name, function".


class InstrumentSection(StrictModel):
    """`[[instruments]]`: an instrument that establishes the traceability of the results."""

    name: _Text
    serial: _Text | None = None
    kind: Literal["table", "site", "other"] = "other"  #: ``site`` is a survey of gravity, latitude or azimuth.
    certificate: _Text | None = None  #: Number of its calibration certificate.
    calibrated: Day | None = None
    due: Day | None = None  #: Date of its next calibration.
