"""Confirmation of an engineer's actions by a second engineer; badge and personal PIN identify both."""

from contextlib import suppress
from dataclasses import dataclass, field
from typing import Literal

from calstation.config import access, library
from calstation.config.product import ProductConfig
from calstation.config.request import Confirmation, plain_text
from calstation.config.station import StationConfig, load_station
from calstation.errors import CalstationError, ConfigurationError
from calstation.messages import Text

#: Overriding a failed unit or check standard, writing registers outside a run, issuing a certificate or a revision, or
#: printing an issued certificate again.
Action = Literal["override", "registers", "certificate", "revision", "reprint"]


@dataclass(frozen=True)
class Person:
    """A person who acts or confirms; without engineers at the station, they give their name and the site's PIN."""

    badge: str
    pin: str = field(default="", repr=False)  #: Empty if no PIN was requested.
    unlocked: bool = False  #: Whether the personal PIN of the badge has unlocked the engineer role of the window.

    def __post_init__(self) -> None:
        """Remove control characters, which some badge readers send."""
        object.__setattr__(self, "badge", plain_text(self.badge))


@dataclass(frozen=True)
class ConfirmationRequired:
    """Requirements of an action: the PIN of the acting person, a badge of the station, and a second person."""

    pin: bool
    badge: bool
    second: bool


def confirmation_required(action: Action, product: ProductConfig, station: StationConfig) -> ConfirmationRequired:
    """Return the requirements at a station of an action with a unit of a product.

    An override always requires a PIN, and the revision of a certificate does at a station that lists engineers; other
    actions require one only if the product requires a second person, and printing a certificate again requires nothing.
    """
    kind = "certificate" if action == "revision" else action
    second = product.confirmation is not None and kind in product.confirmation.required_for
    pin = second or action == "override" or (action == "revision" and bool(_engineers(station)))
    return ConfirmationRequired(pin, station.sign_in is not None, second)


def can_confirm_identity(station: StationConfig) -> bool:
    """Return whether people can prove their identity: the station lists engineers, or the site has a PIN."""
    return bool(_engineers(station)) or access.has_pin()


def confirm(
    action: Action, product: ProductConfig, station: StationConfig, first: Person, second: Person | None = None
) -> Confirmation:
    """Check the identity of the acting person, and of the second person if the product requires one.

    The caller appends the action to the audit trail, with the returned persons, before executing it.

    Parameters
    ----------
    action : the action
    product, station : product and station, which define whether a second person is required and who is an engineer
    first : acting person; a PIN that is given is checked even if it is not required
    second : confirming person, who is checked even if not required

    Raises
    ------
    ConfigurationError : if a person is not an engineer of the station, the station does not accept a badge, a PIN is
        wrong or missing, the second person is missing or identical to the first, or the station lists no engineers
        although two people are required or given.
    """
    needed = confirmation_required(action, product, station)
    if not first.badge:
        raise ConfigurationError("confirmation.no_person")
    engineers, sign_in = _engineers(station), station.sign_in
    # only a typed badge is tested: without a question, the person may be the user of the computer
    is_typed = needed.pin or second is not None or bool(first.pin) or action == "revision"
    if is_typed and not engineers and sign_in is not None and not sign_in.knows(first.badge):
        raise ConfigurationError("confirmation.not_a_badge", badge=first.badge)
    if not needed.pin and second is None and not first.pin:
        proved = first.unlocked and first.badge in engineers
        return Confirmation(station.person(first.badge), pin="personal" if proved else None)
    if (needed.second or second is not None) and not engineers:  # the site's single PIN does not identify two people
        raise ConfigurationError("confirmation.no_engineers", station=station.name, product=product.name)
    if needed.second and second is None:
        raise ConfigurationError("confirmation.second_missing", product=product.name)
    if second is not None and second.badge == first.badge:
        raise ConfigurationError("confirmation.same_person", badge=first.badge)
    for person in filter(None, (first, second)):
        _identify(person, engineers)
    by, confirmed_by = station.person(first.badge), None if second is None else station.person(second.badge)
    return Confirmation(by, confirmed_by, "personal" if engineers else "site")


def unlisted_engineer(badge: str) -> Text | None:
    """Return a warning if no station of the site lists a badge as an engineer's, so that its PIN proves nothing."""
    for name in library.names("stations"):
        with suppress(CalstationError):  # a damaged station file lists nobody
            if badge in _engineers(load_station(library.find("stations", name))[1]):
                return None
    return Text.of("access.badge_unlisted", badge=badge)


def require_no_pin(reason: str, *people: Person | None) -> None:
    """Raise ConfigurationError if a reason, which everyone can read, contains a PIN that was entered."""
    if any(person is not None and person.pin and person.pin in reason for person in people):
        raise ConfigurationError("confirmation.pin_in_reason")


def confirm_at_site(person: Person) -> Confirmation:
    """Check the identity of a person who acts for the whole site, who needs the site's PIN if there is one.

    Raises ConfigurationError.
    """
    if not person.badge:
        raise ConfigurationError("confirmation.no_person")
    if not access.has_pin():
        return Confirmation(person.badge)
    _identify(person, [])
    return Confirmation(person.badge, pin="site")


def _engineers(station: StationConfig) -> list[str]:
    return [] if station.sign_in is None else station.sign_in.engineers


def _identify(person: Person, engineers: list[str]) -> None:
    """Check that a person is an engineer with a correct PIN, or has the site's PIN if there are no engineers.

    Raises ConfigurationError.
    """
    if engineers and person.badge not in engineers:
        raise ConfigurationError("confirmation.not_engineer", badge=person.badge)
    badge = person.badge if engineers else ""
    if not access.has_pin(badge):
        raise ConfigurationError("confirmation.no_pin" if badge else "confirmation.no_site_pin", badge=person.badge)
    if not access.check(person.pin, badge):
        seconds = access.wait(badge)
        if seconds:
            raise ConfigurationError("confirmation.wrong_pin_wait", badge=person.badge, seconds=seconds)
        raise ConfigurationError("confirmation.wrong_pin", badge=person.badge)
