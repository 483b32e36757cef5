"""`override` and `pin`, and the confirmation of an action by one or two engineers, who enter their PINs."""

from dataclasses import replace
from pathlib import Path

import typer

from calstation.cli.show import check_json, ignore_progress, report
from calstation.cli.text import say
from calstation.config import (
    Person,
    RegisterOperation,
    RunRequest,
    access,
    computer_user,
    confirm,
    confirmation_required,
    load_product,
    load_station,
    pin_known,
)
from calstation.results import override_required, override_result


def ask_person(badge: str, *, pin: bool = True) -> Person:
    """Return a person with the PIN that is entered on the terminal, or without one."""
    return Person(badge, _ask(say("cli.ask_pin", badge=badge)) if pin else "")


def ask_people(
    by: str | None, confirmed_by: str | None, default: str, *, pin: bool = False
) -> tuple[Person, Person | None]:
    """Return the acting person, by default `default`, and the confirming person, None if there is none.

    Named persons must enter their PIN; `default` only if `pin` is set or somebody confirms.
    """
    first = ask_person(by or default, pin=pin or bool(by) or confirmed_by is not None)
    return first, None if confirmed_by is None else ask_person(confirmed_by)


def override_command(result: Path, reason: str, by: str | None, confirmed_by: str | None, json: str | None) -> int:
    """Release the unit of a failed result."""
    check_json(json)
    override_required(ignore_progress, result)
    first, second = ask_people(by, confirmed_by, computer_user() or "", pin=True)
    released = override_result(ignore_progress, result, reason, first, second)
    people = [name for name in (released.by, released.confirmed_by) if name]
    report(released.model_dump(), json, [say("cli.released", result=result, people=people)])
    return 0


def confirm_registers(operation: RegisterOperation, by: str | None, confirmed_by: str | None) -> RegisterOperation:
    """Return a register operation with the responsible persons. Raises ConfigurationError."""
    station, product = load_station(operation.request.station)[1], load_product(operation.request.product)[1]
    needed = confirmation_required("registers", product, station)
    first, second = ask_people(by, confirmed_by, operation.request.operator or "", pin=needed.pin)
    people = confirm("registers", product, station, first, second)
    return replace(operation, request=replace(operation.request, operator=people.by), people=people)


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


def pin_command(badge: str) -> int:
    """Set or change the site's PIN, or the personal PIN of an engineer's badge."""
    own = access.has_pin(badge)
    old = ""
    if own:
        old = _ask(say("cli.ask_old_pin"))
    elif badge and access.has_pin():
        old = _ask(say("cli.ask_site_pin"))
    new = typer.prompt(say("cli.ask_new_pin"), hide_input=True, confirmation_prompt=say("cli.ask_again"), err=True)
    access.set_pin(old, str(new), badge)
    report({"badge": badge, "changed": own}, None, [say("cli.pin_set")])
    return 0


def _ask(question: str) -> str:
    return str(typer.prompt(question, hide_input=True, err=True))
