"""Connection to a shared database: URL, credentials and version of its tables."""

from contextlib import suppress
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import URL, Engine, create_engine, make_url
from sqlalchemy.exc import ArgumentError, OperationalError, SQLAlchemyError

from calstation.errors import ConfigurationError

#: Name under which a password is kept in the system's keyring.
KEYRING = "calstation database"

#: Longest time to wait for a connection, s.
CONNECT_TIMEOUT_S = 5


def connect(url: str) -> Engine:
    """Return an engine for a database whose tables are of this version; those of a new SQLite file are created.

    The password comes from ``PGPASSWORD``, from PostgreSQL's password file or from the system's keyring (service
    ``calstation database``, user ``user@host``). Raises ConfigurationError, also if the database is not reachable.
    """
    parsed = _parse(url)
    engine = _engine(parsed)
    if parsed.get_backend_name() == "sqlite":
        upgrade(url)
    try:
        with engine.connect() as connection:
            found = MigrationContext.configure(connection).get_current_revision()
    except OperationalError as exc:
        raise ConfigurationError("database.unreachable", database=_public(parsed), reason=str(exc.orig)) from exc
    if found != ScriptDirectory.from_config(_alembic(parsed)).get_current_head():
        raise ConfigurationError("database.other_version", database=_public(parsed))
    return engine


def upgrade(url: str) -> None:
    """Bring the tables of a database to this version. Raises ConfigurationError."""
    parsed = _parse(url)
    try:
        with _engine(parsed).begin() as connection:
            configuration = _alembic(parsed)
            configuration.attributes["connection"] = connection
            command.upgrade(configuration, "head")
    except SQLAlchemyError as exc:
        raise ConfigurationError("database.not_upgraded", database=_public(parsed), reason=str(exc)) from exc


def _parse(url: str) -> URL:
    try:
        parsed = make_url(url)
    except ArgumentError as exc:
        raise ConfigurationError("database.no_url", url=url) from exc
    if parsed.drivername not in ("sqlite", "postgresql+psycopg"):
        raise ConfigurationError("database.other_kind", kind=parsed.drivername)
    if parsed.password is not None:
        raise ConfigurationError("database.password_in_url")
    return parsed


def _engine(url: URL) -> Engine:
    if url.get_backend_name() == "sqlite":
        return create_engine(url, connect_args={"timeout": 30.0})
    import keyring
    from keyring.errors import KeyringError

    with suppress(KeyringError):  # a computer without a keyring
        url = url.set(password=keyring.get_password(KEYRING, f"{url.username}@{url.host}"))
    return create_engine(url, connect_args={"connect_timeout": CONNECT_TIMEOUT_S}, pool_pre_ping=True)


def _alembic(url: URL) -> Config:
    configuration = Config()
    configuration.set_main_option("script_location", str(Path(__file__).parent / "migrations"))
    return configuration


def _public(url: URL) -> str:
    return url.render_as_string(hide_password=True)
