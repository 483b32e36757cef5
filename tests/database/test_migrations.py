"""The migrations create exactly the declared tables on PostgreSQL and SQLite, and can be reverted."""

import multiprocessing
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from sqlalchemy import create_engine, inspect, select, text

from calstation.cli.app import run_app
from calstation.database import connect, revisions, upgrade
from calstation.database import connect as connect_function
from calstation.database.tables import metadata
from calstation.errors import ConfigurationError
from tests.database.killed import is_killed_at
from tests.helpers import raises_code
from tests.postgres import DATABASES, OWNER

MIGRATIONS = Path(connect_function.__code__.co_filename).parent / "migrations"


@pytest.fixture(params=DATABASES)
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """URL of an empty database."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'shared.sqlite'}"
    server = request.getfixturevalue("postgres")
    return str(server.url(server.new_database()))


def test_migrations_create_the_declared_tables(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(["database", "upgrade", url]) == 0
    line = f"The tables of the database {url} were created or upgraded to this version.\n"
    assert capsys.readouterr().err == line
    assert not upgrade(url)  # tables of this version are not changed
    engine = create_engine(url)
    with engine.begin() as connection:
        assert compare_metadata(MigrationContext.configure(connection), metadata) == []
        assert connection.execute(select(revisions.c.last)).all() == [(0,)]
        configuration = Config()
        configuration.set_main_option("script_location", str(MIGRATIONS))
        configuration.attributes["connection"] = connection
        command.downgrade(configuration, "base")
    assert inspect(engine).get_table_names() == ["alembic_version"]
    engine.dispose()
    upgrade(url)
    engine = create_engine(url)
    with engine.begin() as connection:
        assert compare_metadata(MigrationContext.configure(connection), metadata) == []
    engine.dispose()


def test_the_latest_heads_of_trails_are_found_by_an_index(tmp_path: Path) -> None:
    """Every exchange needs them: without the index, 300 000 heads took 1.5 s."""
    engine = connect(f"sqlite:///{tmp_path / 'shared.sqlite'}")
    with engine.connect() as connection:
        query = "EXPLAIN QUERY PLAN SELECT key, max(lines) FROM trail_heads GROUP BY key"
        plan = [row.detail for row in connection.execute(text(query))]
    engine.dispose()
    assert plan == ["SCAN trail_heads USING COVERING INDEX trail_heads_by_line"]


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize("stride", [17, pytest.param(1, marks=pytest.mark.exhaustive)])
def test_process_killed_while_creating_tables_leaves_a_usable_file(tmp_path: Path, stride: int) -> None:
    number, died = stride, True
    while died:
        url = f"sqlite:///{tmp_path / f'{number}.sqlite'}"
        died = is_killed_at(number, partial(connect, url))
        engine = connect(url)
        with engine.connect() as connection:
            assert compare_metadata(MigrationContext.configure(connection), metadata) == []
            assert connection.execute(select(revisions.c.last)).all() == [(0,)]
        engine.dispose()
        number += stride
    assert number > 25


def create(start: float, url: str) -> None:
    """Connect to a database at a given time."""
    time.sleep(max(0.0, start - time.time()))
    connect(url).dispose()


@pytest.mark.long
def test_two_processes_can_create_the_same_file_simultaneously(tmp_path: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        pool.starmap(create, [(0.0, f"sqlite:///{tmp_path / 'first.sqlite'}")] * 2, chunksize=1)  # imports are done
        for number in range(5):
            work = [(time.time() + 0.2, f"sqlite:///{tmp_path / f'{number}.sqlite'}")] * 2
            pool.starmap(create, work, chunksize=1)


def test_file_locked_by_another_process_is_opened_without_waiting(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    upgrade(url)
    engine = create_engine(url)
    with engine.connect() as writer:
        writer.exec_driver_sql("BEGIN IMMEDIATE")
        connect(url).dispose()  # does not wait for write access
    engine.dispose()


def test_a_database_without_tables_is_refused(postgres) -> None:
    with raises_code(ConfigurationError, "database.older_version"):
        connect(postgres.url(postgres.new_database()))


def test_database_of_a_later_version_is_refused(url: str) -> None:
    upgrade(url)
    engine = create_engine(url)
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    engine.dispose()
    for use in (connect, upgrade):
        with raises_code(ConfigurationError, "database.newer_version"):
            use(url)


def test_login_without_permissions_is_refused(postgres, shared_database: str) -> None:
    postgres.execute("DROP ROLE IF EXISTS stranger")
    postgres.execute("CREATE ROLE stranger LOGIN")
    with raises_code(ConfigurationError, "database.refused") as caught:
        connect(shared_database.replace(f"//{OWNER}@", "//stranger@"))
    assert "permission denied for table alembic_version" in str(caught.value)


def test_statements_have_a_timeout(shared_database: str) -> None:
    engine = connect(shared_database)
    with engine.connect() as connection:
        found = [connection.execute(text(f"SHOW {name}")).scalar() for name in ("lock_timeout", "statement_timeout")]
    engine.dispose()
    assert found == ["20s", "10min"]


@pytest.mark.parametrize("place", ["environment", "keyring"])
def test_unreachable_database_is_reported_without_its_password(monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    if place == "environment":
        monkeypatch.setenv("PGPASSWORD", "geheim")
    else:
        monkeypatch.setattr("keyring.get_password", lambda *_: "geheim")
    with raises_code(ConfigurationError, "database.unreachable") as caught:
        connect("postgresql+psycopg://line@127.0.0.1:1/none")
    assert "line@127.0.0.1" in str(caught.value)
    assert "geheim" not in str(caught.value)


@pytest.mark.parametrize("use", [connect, upgrade])
@pytest.mark.parametrize("away", ["server", "database", "folder"])
def test_remedy_for_an_unreachable_database_does_not_mention_permissions(
    use: Callable[[str], object], away: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    url = f"sqlite:///{tmp_path / 'unmounted' / 'x.sqlite'}"
    if away == "server":
        url = "postgresql+psycopg://line@127.0.0.1:1/none"
    elif away == "database":
        url = request.getfixturevalue("postgres").url("unknown")
    with raises_code(ConfigurationError, "database.unreachable") as caught:
        use(url)
    assert ". Check network, server, port, name of the database, user and password; the folder of" in str(caught.value)


def test_file_that_is_not_a_database_is_not_upgraded(tmp_path: Path) -> None:
    (tmp_path / "x.sqlite").write_text("this is no database, but a text that is long enough for its header" * 10)
    with raises_code(ConfigurationError, "database.not_upgraded"):
        upgrade(f"sqlite:///{tmp_path / 'x.sqlite'}")


@pytest.mark.parametrize(
    ("url", "code"),
    [
        ("postgresql+psycopg://line:geheim@host/name", "database.password_in_url"),
        ("postgresql+psycopg://line@host/name?password=geheim", "database.password_in_url"),
        ("mysql://line:geheim@host/name", "database.other_kind"),
        ("nothing geheim", "database.no_url"),
    ],
)
def test_invalid_url_is_refused_without_showing_it(url: str, code: str) -> None:
    with raises_code(ConfigurationError, code) as caught:
        connect(url)
    assert "geheim" not in str(caught.value)
