"""Laboratory and instruments of a certificate, which are stored in the log so that it needs no other files."""

from datetime import date
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainSerializer

from calstation.schema import EntryError, StrictModel


def _as_date(value: Any) -> date:
    """Parse a date stored as text in a log; return a date read from TOML unchanged."""
    if isinstance(value, date):
        return value
    try:
        return date.fromisoformat(value)
    except (TypeError, ValueError):
        raise EntryError("entry.not_a_date", value=value) from None


_Text = Annotated[str, Field(min_length=1)]
#: A date, which a log stores as ISO 8601 text.
Day = Annotated[date, BeforeValidator(_as_date), PlainSerializer(date.isoformat)]


class LaboratorySection(StrictModel):
    """`[laboratory]`: the laboratory, the location, the customer, and the persons who authorise the certificate."""

    name: _Text
    address: _Text
    country: Annotated[str, Field(pattern="^[A-Z]{2}$")] | None = None  #: ISO 3166-1 code, such as CN.
    place: _Text | None = None  #: Location of the calibration if it differs from `address`.
    accreditation: _Text | None = None  #: Accreditation body and number.
    customer: _Text | None = None
    customer_address: _Text | None = None
    signatories: list[_Text] = Field(default_factory=list)  #: Persons in the form "Name, function".


class InstrumentSection(StrictModel):
    """`[[instruments]]`: an instrument that establishes the traceability of the results."""

    name: _Text
    serial: _Text | None = None
    kind: Literal["table", "site", "other"] = "other"  #: ``site`` is a survey of gravity, latitude or azimuth.
    certificate: _Text | None = None  #: Number of the instrument's calibration certificate.
    calibrated: Day | None = None
    due: Day | None = None  #: Date of the instrument's next calibration.
