"""A PostgreSQL server of the system package, started for tests."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from functools import cached_property
from itertools import count
from pathlib import Path

import pytest

#: Owner of all databases, who may log in without a password over the server's socket and over TCP.
OWNER = "owner"

#: Authentication: members of the role `with_password` need one.
_HBA = """local all all trust
host all +with_password 127.0.0.1/32 scram-sha-256
host all all 127.0.0.1/32 trust
"""

#: Kinds of databases as parameters of fixtures; as every test with the server, those with it are rehearsals.
DATABASES = ["sqlite", pytest.param("postgresql", marks=pytest.mark.long)]

#: Waiting for a start or stop, s.
_WAIT = 60.0


class PostgresServer:
    """A server in a temporary folder that can be stopped, started and disconnected from its clients."""

    def __init__(self, programs: Path) -> None:
        self._programs = programs
        self._folder = Path(tempfile.mkdtemp(prefix="calstation_postgres"))
        self._data = self._folder / "data"
        self._user = _user()
        self._names = (f"test_{number}" for number in count(1))
        if self._user is not None:
            shutil.chown(self._folder, self._user)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port: int = free.getsockname()[1]
        self._run("initdb", "-D", self._data, "-U", OWNER, "-A", "trust", "-E", "UTF8", "--no-sync", "--locale=C")
        (self._data / "pg_hba.conf").write_text(_HBA, encoding="utf-8")
        self.start()
        self.execute("CREATE ROLE with_password")

    def start(self) -> None:
        """Start the server."""
        options = f"-p {self.port} -k {self._folder} -c listen_addresses=127.0.0.1 -c fsync=off -c max_connections=200"
        self._run("pg_ctl", "start", "-w", "-D", self._data, "-l", self._folder / "log", "-o", options)

    def stop(self, mode: str = "immediate") -> None:
        """Stop the server: ``immediate`` like a crash, ``fast`` after disconnecting its clients."""
        self._run("pg_ctl", "stop", "-w", "-m", mode, "-D", self._data)

    def cut(self, database: str) -> int:
        """Terminate all connections to a database; return their number."""
        others = f"FROM pg_stat_activity WHERE datname = '{database}' AND pid <> pg_backend_pid()"
        return int(self.execute(f"SELECT count(pg_terminate_backend(pid)) {others}"))

    def new_database(self, template: str = "template1") -> str:
        """Create a database, empty or as a copy of another one, and return its name."""
        name = next(self._names)
        self.execute(f"CREATE DATABASE {name} TEMPLATE {template}")
        return name

    @cached_property
    def with_tables(self) -> str:
        """Name of a database with the tables of this version, to be copied."""
        from calstation.database import upgrade

        name = self.new_database()
        upgrade(self.url(name))
        return name

    def url(self, database: str, user: str = OWNER) -> str:
        """Return the URL of a database for a user."""
        return f"postgresql+psycopg://{user}@127.0.0.1:{self.port}/{database}"

    def execute(self, command: str, database: str = "postgres", user: str = OWNER) -> str:
        """Execute SQL and return its output as text. Raises CalledProcessError."""
        where = ("-h", self._folder, "-p", str(self.port), "-U", user, "-d", database)
        return self._run("psql", "-X", "-A", "-t", "-q", "-v", "ON_ERROR_STOP=1", *where, "-c", command).strip()

    def remove(self) -> None:
        """Stop the server and delete its files."""
        self.stop()
        shutil.rmtree(self._folder)

    def _run(self, program: str, *arguments: str | Path) -> str:
        # a file, because the started server inherits standard output, and a pipe would never end
        with tempfile.TemporaryFile("w+", encoding="utf-8") as output:
            command = [str(self._programs / program), *map(str, arguments)]
            done = subprocess.run(command, stdout=output, stderr=output, user=self._user, cwd="/", timeout=_WAIT)
            output.seek(0)
            text = output.read()
            if done.returncode:
                raise subprocess.CalledProcessError(done.returncode, command, text)
            return text


def _user() -> str | None:
    """Return the user that runs the server, None for the current user."""
    if os.name == "nt" or os.geteuid() != 0:
        return None
    import pwd

    return "postgres" if "postgres" in {entry.pw_name for entry in pwd.getpwall()} else "nobody"


def installed() -> Path | None:
    """Return the folder of the server programs, None if not installed."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: int(path.parts[-3]))
    if found:
        return found[-1].parent
    program = shutil.which("initdb")
    return None if program is None else Path(program).parent


@pytest.fixture(scope="session")
def postgres() -> Iterator[PostgresServer]:
    """A running server for all tests of a process; a test that stops it starts it again."""
    programs = installed()
    if programs is None:
        pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql)")
    server = PostgresServer(programs)
    yield server
    server.remove()


@pytest.fixture
def shared_database(postgres: PostgresServer) -> str:
    """URL of a new database with the tables of this version."""
    return postgres.url(postgres.new_database(postgres.with_tables))


@pytest.fixture(params=DATABASES)
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """URL of a new database of each type with the tables of this version."""
    if request.param == "postgresql":
        return str(request.getfixturevalue("shared_database"))
    from calstation.database import upgrade

    made = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    upgrade(made)
    return made
