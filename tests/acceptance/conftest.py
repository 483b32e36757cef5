"""What the tests of the command line use, here as well."""

from tests.cli.conftest import calstation

__all__ = ["calstation"]
