"""What the tests of the bench use, here as well."""

from tests.bench.conftest import start_bench

__all__ = ["start_bench"]
