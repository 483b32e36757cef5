"""Connection to a shared database: its URL, the credentials, and the version of its tables."""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import URL, Engine, create_engine, event, make_url, text
from sqlalchemy.exc import ArgumentError, DBAPIError, InterfaceError, OperationalError, SQLAlchemyError
from sqlalchemy.pool import NullPool

from calstation.config import StationConfig, check_database_url, load_station
from calstation.errors import ConfigurationError
from calstation.schema import EntryError

# psycopg warns of a lost connection in addition to the error of the request
logging.getLogger("psycopg").setLevel(logging.ERROR)

#: Service name of the password in the system's keyring.
KEYRING = "calstation database"

#: Longest time to wait for a connection, s.
CONNECT_TIMEOUT_S = 5

#: Prefixes of PostgreSQL's error codes for a lost connection: connection exceptions and server shutdown.
_LOST_CONNECTION = ("08", "57P")

#: A connection whose other end has vanished is closed within half a minute on both sides, which releases its locks. A
#: statement that waits for another station or takes too long fails, and the exchange tries again.
_CONNECTION: dict[str, int | str] = {
    "connect_timeout": CONNECT_TIMEOUT_S,
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "keepalives_count": 3,
    "tcp_user_timeout": 30_000,
    "options": "-c lock_timeout=20s -c statement_timeout=600s -c idle_in_transaction_session_timeout=30s"
    " -c tcp_keepalives_idle=10 -c tcp_keepalives_interval=5 -c tcp_keepalives_count=3",
}


def connect(url: str, *, create: bool = True, pooled: bool = True) -> Engine:
    """Return an engine for a database with tables of this version; the tables of a new SQLite file are created.

    The password comes from ``PGPASSWORD``, from PostgreSQL's password file or from the system's keyring (service
    ``calstation database``, user ``user@host``). Raises ConfigurationError, also if the database is unreachable.

    Parameters
    ----------
    url : URL of the database
    create : whether a missing SQLite file is created; otherwise it is an error
    pooled : whether connections are kept open after use
    """
    parsed = _parse(url)
    is_sqlite = parsed.get_backend_name() == "sqlite"
    if is_sqlite and not create and not Path(parsed.database or "").is_file():
        raise ConfigurationError("database.missing", database=without_password(parsed))
    from calstation.database.migration import known_revisions, revision  # needs an optional dependency

    head, earlier = known_revisions()
    engine = _engine(parsed, pooled=pooled)
    try:
        stored = revision(engine)
        if stored in earlier and is_sqlite:
            upgrade(url)
            stored = revision(engine)
    except DBAPIError as exc:
        engine.dispose()
        raise failure(exc, parsed) from exc
    if stored == head:
        return engine
    engine.dispose()
    code = "database.older_version" if stored in earlier else "database.newer_version"
    raise ConfigurationError(code, database=without_password(parsed))


@contextmanager
def open_database(url: str, *, create: bool = True) -> Iterator[Engine]:
    """Connect to a database; within the context, a refused request or lost connection raises ConfigurationError."""
    engine = connect(url, create=create)
    try:
        yield engine
    except DBAPIError as exc:
        raise failure(exc, engine.url) from exc
    finally:
        engine.dispose()


def upgrade(url: str) -> bool:
    """Upgrade the tables of a database to this version; return whether they changed. Raises ConfigurationError.

    All changes are made in one transaction. If several processes upgrade an SQLite file at once, one changes the tables
    and the others wait for it.
    """
    from calstation.database.migration import upgrade_tables

    parsed = _parse(url)
    engine = _engine(parsed)
    if parsed.get_backend_name() == "sqlite":
        # the driver would otherwise begin a transaction only before the first data change, and not for table changes
        event.listen(engine, "connect", lambda connection, _: setattr(connection, "isolation_level", None))
        event.listen(engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN IMMEDIATE"))
    try:
        try:
            connection = engine.connect()
        except OperationalError as exc:
            raise failure(exc, parsed) from exc
        with connection, connection.begin():
            if parsed.get_backend_name() == "postgresql":
                connection.execute(text("SET LOCAL statement_timeout = 0"))  # large tables take minutes
            return upgrade_tables(connection)
    except LookupError as exc:  # a revision that is unknown to this version
        raise ConfigurationError("database.newer_version", database=without_password(parsed)) from exc
    except SQLAlchemyError as exc:
        raise ConfigurationError(
            "database.not_upgraded", database=without_password(parsed), reason=database_reason(exc)
        ) from exc
    finally:
        engine.dispose()


def database_of(station: Path | None) -> tuple[str, StationConfig]:
    """Return the URL of a station's shared database, and the station. Raises ConfigurationError if there is no URL."""
    path, config = load_station(station)
    if config.records.database is None:
        raise ConfigurationError("database.not_named", path=path)
    return config.records.database, config


def failure(error: DBAPIError, url: URL) -> ConfigurationError:
    """Convert an error of the database driver to the error for an unreachable database or a refused request."""
    state = sqlstate(error)
    lost = isinstance(error, OperationalError | InterfaceError) and (not state or state.startswith(_LOST_CONNECTION))
    code = "database.unreachable" if lost or error.connection_invalidated else "database.refused"
    return ConfigurationError(code, database=without_password(url), reason=database_reason(error))


def sqlstate(error: DBAPIError) -> str:
    """Return PostgreSQL's code for an error; "" for an error of SQLite, the driver or the connection."""
    return getattr(error.orig, "sqlstate", None) or ""


def without_password(url: URL) -> str:
    """Return the text of a URL for messages, without a password."""
    return url.render_as_string(hide_password=True)


def database_reason(error: SQLAlchemyError) -> str:
    """Return the first line of the database's message, without the statement and its values."""
    text = str(error.orig) if isinstance(error, DBAPIError) else str(error)
    return text.partition("\n")[0]


def _parse(url: str) -> URL:
    try:
        check_database_url(url)
        return make_url(url)
    except EntryError as exc:
        raise ConfigurationError(exc.code, **exc.values) from None
    except (ArgumentError, ValueError):
        raise ConfigurationError("database.no_url") from None


def _engine(url: URL, *, pooled: bool = True) -> Engine:
    pool = None if pooled else NullPool
    if url.get_backend_name() == "sqlite":
        return create_engine(url, connect_args={"timeout": 30.0}, poolclass=pool)
    if "PGPASSWORD" not in os.environ:
        from calstation.database.migration import stored_password

        url = url.set(password=stored_password(KEYRING, f"{url.username}@{url.host}"))
    return create_engine(url, connect_args=_CONNECTION, poolclass=pool, pool_pre_ping=True, hide_parameters=True)
