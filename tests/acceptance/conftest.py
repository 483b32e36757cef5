"""Fixtures of the command line's tests."""

from tests.cli.conftest import calstation

__all__ = ["calstation"]
