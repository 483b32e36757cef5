"""Fixtures shared with the tests of the bench."""

from tests.bench.conftest import start_bench

__all__ = ["start_bench"]
