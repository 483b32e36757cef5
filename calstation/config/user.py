"""Whose run it is where nobody has said: the user of this computer."""

import getpass


def computer_user() -> str | None:
    """The user's login name, None where the computer does not tell."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return None
