"""Solutions of a database of the first version keep their meaning after the upgrade."""

import json
from pathlib import Path
from typing import Any

import pytest
from alembic import command
from alembic.config import Config
from sqlalchemy import Connection, create_engine, select, text

from calstation.database import connect, locations, solutions, upgrade, versions
from calstation.database.connect import __file__ as beside
from tests.postgres import DATABASES

COLUMNS = (
    "log_sha256, version, configuration_sha256, first_seq, last_seq, stages, changes_sha256, location, fingerprint, "
    "outcome, failed_checks, parameters, numbers, solved, station, result"
)


@pytest.fixture(params=DATABASES)
def first(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """URL of a database with the tables of the first version and two solutions."""
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    if request.param == "postgresql":
        server = request.getfixturevalue("postgres")
        url = str(server.url(server.new_database()))
    engine = create_engine(url)
    with engine.begin() as connection:
        migrate(connection, "0001")
        for log, location, content in (
            ("a", "/logs/a.h5", {"batch": "B1", "slot": "left", "partial": True}),
            ("b", "/logs/b.h5", {"batch": None}),
        ):
            row: dict[str, Any] = {"log": log, "location": location, "result": json.dumps(content)}
            connection.execute(
                text(
                    f"INSERT INTO solutions ({COLUMNS}) VALUES (:log, '0.1.0+x', '', 0, -1, '', 'c', :location, 'f', "
                    "'resolved', '[]', '[]', '', '2026-01-01', 'bench 1', :result)"
                ),
                row,
            )
    engine.dispose()
    return url


def migrate(connection: Connection, revision: str) -> None:
    """Migrate the tables to a revision."""
    configuration = Config()
    configuration.set_main_option("script_location", str(Path(beside).parent / "migrations"))
    configuration.attributes["connection"] = connection
    command.upgrade(configuration, revision)


def test_migration_fills_columns_locations_and_versions(first: str) -> None:
    assert upgrade(first)
    engine = connect(first)
    with engine.connect() as connection:
        c = solutions.c
        rows = connection.execute(select(c.batch, c.slot, c.partial, c.changed, c.attempt).order_by(c.id)).all()
        places = connection.execute(select(*locations.c).order_by(locations.c.location)).all()
        named = connection.execute(select(*versions.c)).all()
    engine.dispose()
    assert [tuple(row) for row in rows] == [("B1", "left", True, None, 0), (None, None, False, None, 0)]
    assert [tuple(row) for row in places] == [
        ("/logs/a.h5", "f", "a", "bench 1", None, None),
        ("/logs/b.h5", "f", "b", "bench 1", None, None),
    ]
    assert [tuple(row) for row in named] == [("0.1.0+x", "c", 0, -1, "")]
