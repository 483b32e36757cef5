"""Confirmation of an action by one or two engineers, who enter their PINs."""

from dataclasses import replace

import typer

from calstation.cli.text import say
from calstation.config import (
    Person,
    RunRequest,
    computer_user,
    confirm,
    confirmation_required,
    load_product,
    load_station,
    pin_known,
)


def ask_person(badge: str, *, pin: bool = True) -> Person:
    """Return a person with the PIN that is entered on the terminal, or without one."""
    return Person(badge, ask(say("cli.ask_pin", badge=badge)) if pin else "")


def ask_people(
    by: str | None, confirmed_by: str | None, default: str, *, pin: bool = False
) -> tuple[Person, Person | None]:
    """Return the acting person, by default `default`, and the confirming person, None if there is none.

    Named persons must enter their PIN; `default` only if `pin` is set or somebody confirms.
    """
    first = ask_person(by or default, pin=pin or bool(by) or confirmed_by is not None)
    return first, None if confirmed_by is None else ask_person(confirmed_by)


def confirm_override(request: RunRequest, confirmed_by: str | None) -> RunRequest:
    """Return a request with the confirmation of its check standard override that product and site require.

    At a site without PINs the reason suffices. Raises ConfigurationError.
    """
    station, product = load_station(request.station)[1], load_product(request.product)[1]
    second_required = confirmation_required("override", product, station).second
    if not (pin_known(station) or second_required or confirmed_by is not None):
        return request
    first, second = ask_people(request.operator, confirmed_by, computer_user() or "", pin=True)
    return replace(request, overridden_by=confirm("override", product, station, first, second))


def ask(question: str) -> str:
    """Return the answer to a question, which is not shown while it is entered."""
    return str(typer.prompt(question, hide_input=True, err=True))
