"""Tables of the shared database, for PostgreSQL and SQLite; times are UTC."""

from collections.abc import Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite

metadata = sa.MetaData(
    naming_convention={
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "uq": "uq_%(table_name)s_%(column_0_name)s",
        "ix": "ix_%(table_name)s_%(column_0_name)s",
    }
)

#: One row with the last revision of a run and a random name of the database. A lock of this row serialises the
#: transactions, so that revisions appear in order. A new revision is at least the current time, µs since 1970, so that
#: a database restored from a backup does not assign a revision twice.
revisions = sa.Table(
    "revisions",
    metadata,
    sa.Column("last", sa.BigInteger, primary_key=True, autoincrement=False),
    sa.Column("database", sa.String(36), nullable=False),
)

#: The outbox of each folder of runs; `revision` is that of its last message. Only `login`, a role of PostgreSQL, may
#: change rows of the outbox (`roles.sql`).
outboxes = sa.Table(
    "outboxes",
    metadata,
    sa.Column("id", sa.String(36), primary_key=True),
    sa.Column("station", sa.String, nullable=False),
    sa.Column("revision", sa.BigInteger, nullable=False),
    sa.Column("login", sa.String),
)

#: Runs of all stations; `name` is the file name of the log without suffix. The columns from `serial` to `numbers` have
#: the same meaning as in `calstation.records.run_index`.
runs = sa.Table(
    "runs",
    metadata,
    sa.Column("outbox", sa.String(36), sa.ForeignKey("outboxes.id"), primary_key=True),
    sa.Column("name", sa.String, primary_key=True),
    sa.Column("revision", sa.BigInteger, nullable=False, unique=True),
    sa.Column("stamp", sa.Text, nullable=False),  #: Stamp of the files from which the station read the run.
    sa.Column("serial", sa.String, nullable=False, index=True),
    sa.Column("started_utc", sa.String, nullable=False),
    sa.Column("content", sa.Text, nullable=False),
    sa.Column("failed_checks", sa.Text, nullable=False),
    sa.Column("parameters", sa.Text, nullable=False),
    sa.Column("numbers", sa.LargeBinary, nullable=False),
    sa.Column("result", sa.Text),  #: The result JSON.
    sa.Column("log_sha256", sa.String(64)),
    sa.Column("log", sa.Text),  #: Location of the log: URL of the archive, or host and path of the station.
)
#: Condition for runs with a log, which a comparison reads by revision.
_LOGGED = runs.c.log_sha256.is_not(None)
sa.Index("ix_runs_logged", runs.c.revision, postgresql_where=_LOGGED, sqlite_where=_LOGGED)

#: Verified copies of logs in an archive.
log_copies = sa.Table(
    "log_copies",
    metadata,
    sa.Column("outbox", sa.String(36), primary_key=True),
    sa.Column("name", sa.String, primary_key=True),
    sa.Column("url", sa.Text, nullable=False),
    sa.Column("file_sha256", sa.String(64), nullable=False),
    sa.Column("size", sa.BigInteger, nullable=False),
    sa.ForeignKeyConstraint(["outbox", "name"], ["runs.outbox", "runs.name"]),
)

#: Units that stations are working on.
claims = sa.Table(
    "claims",
    metadata,
    sa.Column("serial", sa.String, primary_key=True),
    sa.Column("outbox", sa.String(36), primary_key=True),
    sa.Column("station", sa.String, nullable=False),
    sa.Column("operator", sa.String),
    sa.Column("claimed", sa.DateTime(timezone=True), nullable=False),
    sa.Column("expires", sa.DateTime(timezone=True), nullable=False),
)

#: Heads of the stations' audit trails at the times of their exchanges; rows are never changed or deleted, so that a
#: trail that was cut later contradicts them.
trail_heads = sa.Table(
    "trail_heads",
    metadata,
    sa.Column("outbox", sa.String(36), sa.ForeignKey("outboxes.id"), primary_key=True),
    sa.Column("key", sa.String(64), primary_key=True),  #: Public key of the trail.
    sa.Column("lines", sa.BigInteger, primary_key=True, autoincrement=False),
    sa.Column("digest", sa.String(64), primary_key=True),
    sa.Column("station", sa.String, nullable=False),
    sa.Column("stored", sa.DateTime(timezone=True), nullable=False),
    sa.Index("trail_heads_by_line", "key", "lines"),
)

#: Properties common to all solutions with a version; the first job that uses a version adds its row.
versions = sa.Table(
    "versions",
    metadata,
    #: Software version, with ``+label`` if the configuration was changed.
    sa.Column("version", sa.String, primary_key=True),
    sa.Column("changes_sha256", sa.String(64), nullable=False),  #: Digest of the changes to the configuration.
    #: First requested sequence number; 0 for the start of the log.
    sa.Column("first_seq", sa.BigInteger, nullable=False),
    sa.Column("last_seq", sa.BigInteger, nullable=False),  #: Last requested sequence number; -1 for the end of the log.
    #: Requested stages, separated by commas; empty for the stages of the log.
    sa.Column("stages", sa.String, nullable=False),
)

#: Files that have been read, so that unchanged files are not read again; several files may contain the same log.
locations = sa.Table(
    "locations",
    metadata,
    sa.Column("location", sa.Text, primary_key=True),  #: URL or path of the log.
    sa.Column("fingerprint", sa.String, primary_key=True),  #: Stamp of its files; the digest of a file in the archive.
    sa.Column("log_sha256", sa.String(64)),  #: NULL for a log that was not selected and therefore not read to its end.
    sa.Column("station", sa.String),
    sa.Column("product", sa.String),
    sa.Column("started_utc", sa.String),
)

#: Solutions of logs. A solution is identified by log, version, configuration, requested range and stages. Every
#: repeated attempt at a failed log adds a row, and the last row is valid.
solutions = sa.Table(
    "solutions",
    metadata,
    sa.Column("id", sa.BigInteger().with_variant(sa.Integer, "sqlite"), primary_key=True),
    sa.Column("log_sha256", sa.String(64), nullable=False),  #: Digest of the file's bytes for an unreadable log.
    sa.Column("version", sa.String, nullable=False),
    sa.Column("configuration_sha256", sa.String(64), nullable=False),
    sa.Column("first_seq", sa.BigInteger, nullable=False),
    sa.Column("last_seq", sa.BigInteger, nullable=False),
    sa.Column("stages", sa.String, nullable=False),
    sa.Column("changes_sha256", sa.String(64), nullable=False),
    sa.Column("attempt", sa.Integer, nullable=False, server_default=sa.text("0")),
    sa.Column("location", sa.Text, nullable=False),  #: URL or path from which the log was read.
    sa.Column("outcome", sa.String, nullable=False),  #: ``resolved`` or ``failed``.
    sa.Column("error_code", sa.String),
    sa.Column("passed", sa.Boolean),
    #: Whether stages of the product were omitted.
    sa.Column("partial", sa.Boolean, nullable=False, server_default=sa.false()),
    #: Whether configuration, range or stages differ from those in the log; NULL if unknown.
    sa.Column("changed", sa.Boolean),
    sa.Column("serial", sa.String),
    sa.Column("product", sa.String),
    sa.Column("station", sa.String),
    sa.Column("started_utc", sa.String),
    sa.Column("batch", sa.String),
    sa.Column("slot", sa.String),
    sa.Column("failed_checks", sa.Text, nullable=False),
    sa.Column("parameters", sa.Text, nullable=False),
    sa.Column("numbers", sa.LargeBinary, nullable=False),
    sa.Column("solved", sa.DateTime(timezone=True), nullable=False),
    sa.Column("result", sa.Text, nullable=False),
    sa.UniqueConstraint("log_sha256", "version", "configuration_sha256", "first_seq", "last_seq", "stages", "attempt"),
    sa.Index("ix_solutions_version", "version", "id"),
)


def upsert(
    connection: sa.Connection, table: sa.Table, rows: Sequence[dict[str, Any]], **replaced: sa.ColumnElement[Any]
) -> None:
    """Add rows, replacing rows with the same primary keys; psycopg sends all of them in one round trip.

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
