"""Laboratory and instruments of a certificate, stored in the log so that a certificate needs no other files."""

import re
from datetime import date
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainSerializer

from calstation.schema import EntryError, StrictModel

#: Officially assigned codes of ISO 3166-1.
COUNTRIES = frozenset(
    re.findall(
        "[A-Z]{2}",
        "AD AE AF AG AI AL AM AO AQ AR AS AT AU AW AX AZ BA BB BD BE BF BG BH BI BJ BL BM BN BO BQ BR BS BT BV BW BY "
        "BZ CA CC CD CF CG CH CI CK CL CM CN CO CR CU CV CW CX CY CZ DE DJ DK DM DO DZ EC EE EG EH ER ES ET FI FJ FK "
        "FM FO FR GA GB GD GE GF GG GH GI GL GM GN GP GQ GR GS GT GU GW GY HK HM HN HR HT HU ID IE IL IM IN IO IQ IR "
        "IS IT JE JM JO JP KE KG KH KI KM KN KP KR KW KY KZ LA LB LC LI LK LR LS LT LU LV LY MA MC MD ME MF MG MH MK "
        "ML MM MN MO MP MQ MR MS MT MU MV MW MX MY MZ NA NC NE NF NG NI NL NO NP NR NU NZ OM PA PE PF PG PH PK PL PM "
        "PN PR PS PT PW PY QA RE RO RS RU RW SA SB SC SD SE SG SH SI SJ SK SL SM SN SO SR SS ST SV SX SY SZ TC TD TF "
        "TG TH TJ TK TL TM TN TO TR TT TV TW TZ UA UG UM US UY UZ VA VC VE VG VI VN VU WF WS YE YT ZA ZM ZW ",
    )
)


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

    @property
    def required(self) -> bool:
        """Whether production is refused if the calibration is overdue."""
        return self.kind in ("table", "site")
