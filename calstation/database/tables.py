"""Tables of the shared database, for PostgreSQL and SQLite; times are UTC."""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    ColumnElement,
    Connection,
    DateTime,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
    false,
    text,
)
from sqlalchemy.dialects import postgresql, sqlite

metadata = MetaData(
    naming_convention={
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "uq": "uq_%(table_name)s_%(column_0_name)s",
        "ix": "ix_%(table_name)s_%(column_0_name)s",
    }
)

#: One row: the last revision of a run, and a random name of the database. The row's lock orders the transactions, so
#: that revisions appear in order. Revisions are not below the time, µs since 1970, so that a database restored from a
#: backup does not assign a revision twice.
revisions = Table(
    "revisions",
    metadata,
    Column("last", BigInteger, primary_key=True, autoincrement=False),
    Column("database", String(36), nullable=False),
)

#: The outbox of each folder of runs; `revision` is that of its last message. Only `login`, a role of PostgreSQL, may
#: change rows of the outbox (`roles.sql`).
outboxes = Table(
    "outboxes",
    metadata,
    Column("id", String(36), primary_key=True),
    Column("station", String, nullable=False),
    Column("revision", BigInteger, nullable=False),
    Column("login", String),
)

#: Runs of all stations; `name` is the file name of the log without suffix. The columns from `serial` to `numbers` have
#: the same meaning as in `calstation.records.run_index`.
runs = Table(
    "runs",
    metadata,
    Column("outbox", String(36), ForeignKey("outboxes.id"), primary_key=True),
    Column("name", String, primary_key=True),
    Column("revision", BigInteger, nullable=False, unique=True),
    Column("stamp", Text, nullable=False),  #: Stamp of the files from which the station read the run.
    Column("serial", String, nullable=False, index=True),
    Column("started_utc", String, nullable=False),
    Column("content", Text, nullable=False),
    Column("failed_checks", Text, nullable=False),
    Column("parameters", Text, nullable=False),
    Column("numbers", LargeBinary, nullable=False),
    Column("result", Text),  #: The result JSON.
    Column("log_sha256", String(64)),
    Column("log", Text),  #: Location of the log: URL of the archive, or host and path of the station.
)
#: Runs that have a log, by revision, as read by a comparison.
_LOGGED = runs.c.log_sha256.is_not(None)
Index("ix_runs_logged", runs.c.revision, postgresql_where=_LOGGED, sqlite_where=_LOGGED)

#: Verified copies of logs in an archive.
log_copies = Table(
    "log_copies",
    metadata,
    Column("outbox", String(36), primary_key=True),
    Column("name", String, primary_key=True),
    Column("url", Text, nullable=False),
    Column("file_sha256", String(64), nullable=False),
    Column("size", BigInteger, nullable=False),
    ForeignKeyConstraint(["outbox", "name"], ["runs.outbox", "runs.name"]),
)

#: Units that stations are working on.
claims = Table(
    "claims",
    metadata,
    Column("serial", String, primary_key=True),
    Column("outbox", String(36), primary_key=True),
    Column("station", String, nullable=False),
    Column("operator", String),
    Column("claimed", DateTime(timezone=True), nullable=False),
    Column("expires", DateTime(timezone=True), nullable=False),
)

#: Common properties of the solutions of a version; the first job that uses a version adds it.
versions = Table(
    "versions",
    metadata,
    Column("version", String, primary_key=True),  #: Software version, with ``+label`` if the configuration was changed.
    Column("changes_sha256", String(64), nullable=False),  #: Digest of the changes to the configuration.
    Column("first_seq", BigInteger, nullable=False),  #: First requested sequence number; 0 for the start of the log.
    Column("last_seq", BigInteger, nullable=False),  #: Last requested sequence number; -1 for the end of the log.
    #: Requested stages, separated by commas; empty for the stages of the log.
    Column("stages", String, nullable=False),
)

#: Files that have been read, so that unchanged files are not read again; several files may contain the same log.
locations = Table(
    "locations",
    metadata,
    Column("location", Text, primary_key=True),  #: URL or path of the log.
    Column("fingerprint", String, primary_key=True),  #: Stamp of its files; the digest of a file in the archive.
    Column("log_sha256", String(64)),  #: NULL for a log that was not selected and therefore not read to its end.
    Column("station", String),
    Column("product", String),
    Column("started_utc", String),
)

#: Solutions of logs. A solution is identified by log, version, configuration, requested range and stages. Every
#: repeated attempt at a failed log adds a row, and the last row is valid.
solutions = Table(
    "solutions",
    metadata,
    Column("id", BigInteger().with_variant(Integer, "sqlite"), primary_key=True),
    Column("log_sha256", String(64), nullable=False),  #: Digest of the file's bytes for an unreadable log.
    Column("version", String, nullable=False),
    Column("configuration_sha256", String(64), nullable=False),
    Column("first_seq", BigInteger, nullable=False),
    Column("last_seq", BigInteger, nullable=False),
    Column("stages", String, nullable=False),
    Column("changes_sha256", String(64), nullable=False),
    Column("attempt", Integer, nullable=False, server_default=text("0")),
    Column("location", Text, nullable=False),  #: URL or path from which the log was read.
    Column("outcome", String, nullable=False),  #: ``resolved`` or ``failed``.
    Column("error_code", String),
    Column("passed", Boolean),
    Column("partial", Boolean, nullable=False, server_default=false()),  #: Whether stages of the product were omitted.
    Column("changed", Boolean),  #: Whether configuration, range or stages differ from the log's own; NULL: unknown.
    Column("serial", String),
    Column("product", String),
    Column("station", String),
    Column("started_utc", String),
    Column("batch", String),
    Column("slot", String),
    Column("failed_checks", Text, nullable=False),
    Column("parameters", Text, nullable=False),
    Column("numbers", LargeBinary, nullable=False),
    Column("solved", DateTime(timezone=True), nullable=False),
    Column("result", Text, nullable=False),
    UniqueConstraint("log_sha256", "version", "configuration_sha256", "first_seq", "last_seq", "stages", "attempt"),
    Index("ix_solutions_version", "version", "id"),
)


def upsert(
    connection: Connection, table: Table, rows: Sequence[dict[str, Any]], **replaced: ColumnElement[Any]
) -> None:
    """Add rows, or replace rows with the same primary keys; psycopg sends all of them in one round trip.

    Parameters
    ----------
    connection : connection in a transaction
    table : table of the rows
    rows : values by the names of the columns, the same columns in each row
    replaced : expressions, by column, that set a column of an existing row instead of its new value
    """
    if not rows:
        return
    insert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
    statement = insert(table)
    keys = [column.name for column in table.primary_key]
    values = {name: statement.excluded[name] for name in rows[0] if name not in keys}
    connection.execute(statement.on_conflict_do_update(index_elements=keys, set_={**values, **replaced}), rows)
