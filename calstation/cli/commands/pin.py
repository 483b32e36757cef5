"""`pin`: sets the PIN of the site or of an engineer."""

import typer

from calstation.cli.confirmation import ask
from calstation.cli.options import command_group
from calstation.cli.show import emit, plain_console, show_line
from calstation.cli.text import say, sentence
from calstation.config import access, unlisted_engineer

app = command_group()


@app.command()
def pin(badge: str = "") -> None:
    """Set or change the PIN of the site, or the personal PIN of the engineer with a badge."""
    exists = access.has_pin(badge)
    old = ""
    if exists:
        old = ask(say("cli.ask_old_pin"))
    elif badge and access.has_pin():
        old = ask(say("cli.ask_site_pin"))
    new = typer.prompt(say("cli.ask_new_pin"), hide_input=True, confirmation_prompt=say("cli.ask_again"), err=True)
    access.set_pin(old, str(new), badge)
    emit({"badge": badge, "changed": exists}, None, [say("cli.pin_set")])
    unlisted = unlisted_engineer(badge) if badge else None
    if unlisted is not None:
        show_line(plain_console(stderr=True), sentence(unlisted))
