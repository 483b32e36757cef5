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
#: that revisions appear in their order. Revisions are not below the time, µs since 1970, so that a database which is
#: restored from a backup gives none for a second time.
revisions = Table(
    "revisions",
    metadata,
    Column("last", BigInteger, primary_key=True, autoincrement=False),
    Column("database", String(36), nullable=False),
)

#: The outbox of each folder of runs; `last_number` is the last of its messages that arrived. Only `login`, a role of
#: PostgreSQL, may change what belongs to the outbox (`roles.sql`).
outboxes = Table(
    "outboxes",
    metadata,
    Column("id", String(36), primary_key=True),
    Column("station", String, nullable=False),
    Column("last_number", BigInteger, nullable=False),
    Column("login", String),
)

#: Runs of all stations; `name` is the file name of the log without suffix. The columns from `serial` to `numbers` have
#: the meaning of those of `calstation.records.run_index`.
runs = Table(
    "runs",
    metadata,
    Column("outbox", String(36), ForeignKey("outboxes.id"), primary_key=True),
    Column("name", String, primary_key=True),
    Column("revision", BigInteger, nullable=False, unique=True),
    Column("serial", String, nullable=False, index=True),
    Column("started_utc", String, nullable=False),
    Column("content", Text, nullable=False),
    Column("failed_checks", Text, nullable=False),
    Column("parameters", Text, nullable=False),
    Column("numbers", LargeBinary, nullable=False),
    Column("result", Text),  #: The result JSON.
    Column("log_sha256", String(64)),
    Column("log", Text),  #: Where the log lies: URL of the archive, or host and path of the station.
)

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

#: Units that stations work on at present.
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

#: Logs that were solved again. A solution is identified by log, version, configuration, wanted range and stages.
solutions = Table(
    "solutions",
    metadata,
    Column("id", BigInteger().with_variant(Integer, "sqlite"), primary_key=True),
    Column("log_sha256", String(64), nullable=False),  #: That of the bytes of the file for an unreadable log.
    Column("version", String, nullable=False),  #: Software version, with ``+label`` if the configuration was changed.
    Column("configuration_sha256", String(64), nullable=False),
    Column("first_seq", BigInteger, nullable=False),  #: First wanted sequence number; 0 for the start of the log.
    Column("last_seq", BigInteger, nullable=False),  #: Last wanted sequence number; -1 for the end of the log.
    Column("stages", String, nullable=False),  #: Wanted stages, separated by commas; empty for those of the log.
    Column("changes_sha256", String(64), nullable=False),  #: Digest of the changes to the configuration.
    Column("location", Text, nullable=False),  #: URL or path of the log.
    Column("fingerprint", String, nullable=False),  #: Stamp of the file at `location`.
    Column("outcome", String, nullable=False),  #: ``resolved`` or ``failed``.
    Column("error_code", String),
    Column("passed", Boolean),
    Column("serial", String),
    Column("product", String),
    Column("station", String),
    Column("started_utc", String),
    Column("failed_checks", Text, nullable=False),
    Column("parameters", Text, nullable=False),
    Column("numbers", LargeBinary, nullable=False),
    Column("solved", DateTime(timezone=True), nullable=False),
    Column("result", Text, nullable=False),
    UniqueConstraint("log_sha256", "version", "configuration_sha256", "first_seq", "last_seq", "stages"),
    Index("ix_solutions_version", "version", "id"),
)


def upsert(
    connection: Connection, table: Table, rows: Sequence[dict[str, Any]], **replaced: ColumnElement[Any]
) -> None:
    """Add rows, or replace those with the same primary keys; psycopg sends all of them in one round trip.

    Parameters
    ----------
    connection : connection in a transaction
    table : table of the rows
    rows : values by the names of the columns, the same columns in each row
    replaced : expressions for columns of an existing row that do not simply get the new value
    """
    if not rows:
        return
    insert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
    statement = insert(table)
    keys = [column.name for column in table.primary_key]
    values = {name: statement.excluded[name] for name in rows[0] if name not in keys}
    connection.execute(statement.on_conflict_do_update(index_elements=keys, set_={**values, **replaced}), rows)
