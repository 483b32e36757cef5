"""Each role can do its work in the shared database and nothing else."""

import subprocess
from pathlib import Path

import pytest

from calstation.cli.app import run_app
from calstation.database import Exchange
from tests.database.result_files import in_database, in_index, write_result


@pytest.fixture
def database(postgres, shared_database: str, capsys: pytest.CaptureFixture[str]) -> str:
    """Name of a database with the roles, and a login of each: ``line``, ``solver``, ``quality`` and ``nobody_here``."""
    name = shared_database.rpartition("/")[2]
    assert run_app(["database", "roles"]) == 0
    roles = capsys.readouterr().out
    for _ in range(2):  # also where the roles exist
        postgres.execute(roles, name)
    for login, role in (("line", "station"), ("solver", "fleet"), ("quality", "reader"), ("nobody_here", "")):
        postgres.execute(f"DROP ROLE IF EXISTS {login}")
        postgres.execute(f"CREATE ROLE {login} LOGIN {f'IN ROLE calstation_{role}' if role else ''}")
    return name


def test_stations_exchange_and_claim_with_their_role(postgres, database: str, tmp_path: Path) -> None:
    url = postgres.url(database, "line")
    folders = tmp_path / "line 1", tmp_path / "line 2"
    exchanges = []
    for number, folder in enumerate(folders):
        folder.mkdir()
        write_result(folder, f"run{number}", number)
        exchange = Exchange(folder, url, folder.name, {"SN-3": "li"})
        exchange.exchange()
        exchange.claimed = {"SN-2": "li"}
        exchange.exchange()
        exchange.outbox.add_copy(f"run{number}", "s3://logs/x.h5", "0" * 64, 1)
        exchanges.append(exchange)
    for number in (0, 1, 0):
        assert [claim.serial for claim in exchanges[number].exchange()] == ["SN-2"]
        write_result(folders[number], f"run{number}", 5, outcome="failed")
        exchanges[number].exchange()
    for exchange in exchanges:
        exchange.close()
    assert in_index(folders[0]) == in_index(folders[1])
    assert len(in_database(postgres.url(database))) == 2


FORBIDDEN = {
    "line": [
        "DELETE FROM runs",
        "TRUNCATE runs",
        "DELETE FROM outboxes",
        "DELETE FROM log_copies",
        "DELETE FROM revisions",
        "INSERT INTO revisions VALUES (9, 'x')",
        "SELECT * FROM solutions",
        "INSERT INTO solutions (id) VALUES (1)",
        "UPDATE alembic_version SET version_num = '0'",
        "CREATE TABLE mine (a int)",
        "CREATE SCHEMA mine",
        "CREATE TEMPORARY TABLE mine (a int)",
        "DROP TABLE runs",
        "ALTER TABLE runs ADD COLUMN mine int",
        "CREATE ROLE another",
        "CREATE DATABASE another",
        "COPY runs TO '/tmp/runs'",
    ],
    "solver": [
        "INSERT INTO outboxes VALUES ('a', 'b', 0)",
        "UPDATE runs SET serial = ''",
        "DELETE FROM runs",
        "UPDATE solutions SET passed = true",
        "DELETE FROM solutions",
        "SELECT * FROM claims",
        "CREATE TABLE mine (a int)",
    ],
    "quality": [
        "UPDATE runs SET serial = ''",
        "DELETE FROM solutions",
        "DELETE FROM claims",
        "UPDATE revisions SET last = 0",
        "INSERT INTO outboxes VALUES ('a', 'b', 0)",
        "CREATE TABLE mine (a int)",
    ],
    "nobody_here": ["SELECT 1"],
}


@pytest.mark.parametrize("login", FORBIDDEN)
def test_a_role_can_do_nothing_else(postgres, database: str, login: str) -> None:
    for command in FORBIDDEN[login]:
        with pytest.raises(subprocess.CalledProcessError) as caught:
            postgres.execute(command, database, login)
        said = caught.value.output
        refused = ("permission denied", "must be owner", "must be superuser")
        assert any(words in said for words in refused), f"{command}: {said}"


def test_fleet_and_reader_read_runs_and_solutions(postgres, database: str) -> None:
    for login in ("solver", "quality"):
        for table in ("runs", "outboxes", "log_copies", "solutions", "alembic_version"):
            assert postgres.execute(f"SELECT count(*) FROM {table}", database, login) in ("0", "1")
    assert postgres.execute("SELECT nextval('solutions_id_seq')", database, "solver") == "1"
    postgres.execute("UPDATE solutions SET location = '', fingerprint = ''", database, "solver")
