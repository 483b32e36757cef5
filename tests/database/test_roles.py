"""Each database role has exactly the permissions it needs."""

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from synthetic.many_logs import record_logs

from calstation import __version__
from calstation.cli.app import run_app
from calstation.database import ArchivedLog, Exchange, adopt_folder
from calstation.errors import ConfigurationError
from calstation.fleet import FleetRequest, compare, compare_job, resolve_fleet, versions_job
from tests.database.result_files import in_database, in_index, write_result
from tests.database.test_claims import station_file
from tests.helpers import ignore_progress, raises_code


@pytest.fixture
def database(postgres, shared_database: str, capsys: pytest.CaptureFixture[str]) -> str:
    """Name of a database with a login for each role: ``line``, ``solver``, ``quality`` and ``nobody_here``."""
    name = shared_database.rpartition("/")[2]
    assert run_app(["database", "roles"]) == 0
    roles = capsys.readouterr().out
    for _ in range(2):  # the second time, the roles already exist
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
        exchange.outbox.add_copy(ArchivedLog(f"run{number}", "s3://logs/x.h5", "0" * 64, 1))
        exchanges.append(exchange)
    for number in (0, 1, 0):
        assert [claim.serial for claim in exchanges[number].exchange()] == ["SN-2"]
        write_result(folders[number], f"run{number}", 5, outcome="failed")
        exchanges[number].exchange()
    for exchange in exchanges:
        exchange.close()
    assert in_index(folders[0]) == in_index(folders[1])
    assert len(in_database(postgres.url(database))) == 2


def test_stations_compare_versions_with_their_role(
    postgres, database: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    folder = tmp_path / "line 1"
    folder.mkdir()
    write_result(folder, "a", 1)
    url = postgres.url(database, "line")
    exchange = Exchange(folder, url, "line 1")
    exchange.exchange()
    exchange.close()
    station = station_file(folder, url)
    assert versions_job(ignore_progress, station) == ["online"]
    assert compare_job(ignore_progress, station, "online", "online").logs == 1
    with raises_code(ConfigurationError, "fleet.no_version"):
        compare_job(ignore_progress, station, "online", "9.9")


def test_a_station_changes_only_its_own_runs(postgres, database: str, tmp_path: Path) -> None:
    postgres.execute("DROP ROLE IF EXISTS line2")
    postgres.execute("CREATE ROLE line2 LOGIN IN ROLE calstation_station")
    url = postgres.url(database)
    folder = tmp_path / "line 1"
    folder.mkdir()
    write_result(folder, "a", 1)
    station = Exchange(folder, postgres.url(database, "line"), "line 1", {"SN-1": "li"})
    station.outbox.add_copy(ArchivedLog("a", "s3://logs/a.h5", "0" * 64, 1))
    station.exchange()
    for command in (
        "UPDATE runs SET serial = 'x'",
        "UPDATE outboxes SET revision = 0",
        "UPDATE outboxes SET login = 'line2'",
        "UPDATE log_copies SET url = ''",
        "DELETE FROM claims",
    ):
        assert (
            postgres.execute(f"WITH changed AS ({command} RETURNING 1) SELECT count(*) FROM changed", database, "line2")
            == "0"
        )
    for command in (
        f"INSERT INTO claims VALUES ('SN-9', '{station.outbox.id}', 'line 2', NULL, now(), now())",
        f"INSERT INTO log_copies VALUES ('{station.outbox.id}', 'b', '', '', 1)",
        "INSERT INTO outboxes VALUES ('other', 'line 2', 0, 'line')",
    ):
        with pytest.raises(subprocess.CalledProcessError) as refused:
            postgres.execute(command, database, "line2")
        assert "violates row-level security policy" in refused.value.output

    # a copy of the folder that has the same outbox, at a station with another login
    copy = tmp_path / "line 2"
    shutil.copytree(folder, copy)
    adopt_folder(copy, copied=False)
    write_result(copy, "b", 2)
    other = Exchange(copy, postgres.url(database, "line2"), "line 2")
    with raises_code(ConfigurationError, "database.other_login") as caught:
        other.exchange()
    other.close()
    assert caught.value.values["login"] == "line"
    assert len(in_database(url)) == 1
    adopt_folder(copy, copied=True)
    other = Exchange(copy, postgres.url(database, "line2"), "line 2")
    other.exchange()
    assert len(in_database(url)) == 3

    # the folder gets another login
    postgres.execute("UPDATE outboxes SET login = NULL WHERE station = 'line 1'", database)
    station.close()
    write_result(folder, "a", 3)
    station = Exchange(folder, postgres.url(database, "line2"), "line 1")
    station.exchange()
    assert sorted(name for name, _ in in_database(url)) == ["a", "a", "b"]
    assert postgres.execute("SELECT string_agg(login, ' ') FROM outboxes", database) == "line2 line2"
    for each in (station, other):
        each.close()


def test_without_row_policies_the_last_login_owns_the_folder(postgres, shared_database: str, tmp_path: Path) -> None:
    postgres.execute("DROP ROLE IF EXISTS anybody")
    postgres.execute("CREATE ROLE anybody SUPERUSER LOGIN")
    name = shared_database.rpartition("/")[2]
    write_result(tmp_path, "a", 1)
    for login in ("owner", "anybody"):
        exchange = Exchange(tmp_path, postgres.url(name, login), "line 1")
        exchange.exchange()
        exchange.close()
        assert postgres.execute("SELECT login FROM outboxes", name) == login


FORBIDDEN = {
    "line": [
        "DELETE FROM runs",
        "TRUNCATE runs",
        "DELETE FROM outboxes",
        "DELETE FROM log_copies",
        "DELETE FROM revisions",
        "INSERT INTO revisions VALUES (9, 'x')",
        "UPDATE solutions SET passed = true",
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
def test_statements_outside_a_role_are_denied(postgres, database: str, login: str) -> None:
    for command in FORBIDDEN[login]:
        with pytest.raises(subprocess.CalledProcessError) as caught:
            postgres.execute(command, database, login)
        output = caught.value.output
        refused = ("permission denied", "must be owner", "must be superuser")
        assert any(words in output for words in refused), f"{command}: {output}"


def test_fleet_and_reader_read_runs_and_solutions(postgres, database: str, tmp_path: Path) -> None:
    logs = record_logs(ignore_progress, tmp_path / "logs", 2, seed=7)
    request = FleetRequest((str(tmp_path / "logs"),), postgres.url(database, "solver"), "local:1")
    assert resolve_fleet(request).solved_now == 2
    moved = tmp_path / "moved"
    shutil.move(logs[0].parent, moved)
    assert resolve_fleet(replace(request, sources=(str(moved),))).already_there == 2
    for login in ("solver", "quality"):
        for table in ("runs", "outboxes", "log_copies", "solutions", "versions", "locations", "alembic_version"):
            postgres.execute(f"SELECT count(*) FROM {table}", database, login)
    compared = compare(ignore_progress, postgres.url(database, "quality"), __version__, __version__)
    assert compared.logs == 2
