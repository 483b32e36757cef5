"""Many short logs, and databases for their solutions."""

import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from tests.cli.conftest import calstation as calstation
from tests.helpers import ignore_progress
from tests.postgres import postgres as postgres
from tests.postgres import shared_database as shared_database
from tests.postgres import url as url
from tests.synthetic.many_logs import record_logs


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], list[Path]]:
    """Make that many logs of different units in a folder of their own, once."""

    @cache
    def make(count: int) -> list[Path]:
        return record_logs(ignore_progress, tmp_path_factory.mktemp("logs"), count, seed=4)

    return make


@pytest.fixture
def logs(made: Callable[[int], list[Path]], tmp_path: Path) -> list[Path]:
    """Six logs in a folder of their own."""
    folder = tmp_path / "logs"
    folder.mkdir()
    return [Path(shutil.copy2(path, folder)) for path in made(6)]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Allow sockets that distributed leaves to the garbage collector."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.filterwarnings("ignore::ResourceWarning"))
            item.add_marker(pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"))
