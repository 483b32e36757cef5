"""Confirmation of an action by one or two engineers, who enter their PINs."""

from typing import TYPE_CHECKING

import typer

from calstation.cli.text import say
from calstation.config import Person, can_confirm_identity, computer_user, load_station, require_no_pin
from calstation.errors import ConfigurationError

if TYPE_CHECKING:
    from calstation.runs import RunStart


def ask_person(badge: str, *, pin: bool = True, reason: str = "") -> Person:
    """Return the person with a badge and, if `pin` is set, the PIN entered on the terminal.

    Raises ConfigurationError if the reason for the action contains this PIN.
    """
    person = Person(badge, ask(say("cli.ask_pin", badge=badge)) if pin else "")
    require_no_pin(reason, person)
    return person


def ask_people(
    by: str | None, confirmed_by: str | None, default: str, *, pin: bool = False, reason: str = ""
) -> tuple[Person, Person | None]:
    """Return the acting person, and the confirming person or None.

    Named persons must enter their PIN; the default person must do so only if `pin` is set or a second person confirms.
    Raises ConfigurationError if both are the same person, or the reason contains a PIN.

    Parameters
    ----------
    by, confirmed_by : badges of the acting and the confirming person, if named
    default : badge or name of the acting person by default
    pin : whether `default` must always enter a PIN
    reason : reason for the action
    """
    if confirmed_by is not None and Person(confirmed_by).badge == Person(by or default).badge:
        raise ConfigurationError("confirmation.same_person", badge=confirmed_by)
    first = ask_person(by or default, pin=pin or bool(by) or confirmed_by is not None, reason=reason)
    return first, None if confirmed_by is None else ask_person(confirmed_by, reason=reason)


def confirm_override(start: "RunStart", reason: str, confirmed_by: str | None) -> None:
    """Permit a run despite an overdue or failed check standard, with the confirmation that product and site require.

    At a site without PINs the reason suffices. Raises ConfigurationError.
    """
    request, first, second = start.request, None, None
    if (
        can_confirm_identity(load_station(request.station)[1])
        or start.override_required.second
        or confirmed_by is not None
    ):
        first, second = ask_people(request.operator, confirmed_by, computer_user() or "", pin=True, reason=reason)
    start.override(reason, first, second)


def ask(question: str) -> str:
    """Ask a question on the terminal without showing the typed text, and return the answer."""
    return str(typer.prompt(question, hide_input=True, err=True))
