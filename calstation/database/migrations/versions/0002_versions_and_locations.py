"""Add versions and locations of solutions, and columns for the parts of a result used by comparisons and exports."""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"

_KEY = ("log_sha256", "version", "configuration_sha256", "first_seq", "last_seq", "stages")
_UNIQUE = "uq_solutions_log_sha256"


def upgrade() -> None:
    op.create_table(
        "versions",
        sa.Column("version", sa.String(), nullable=False),
        sa.Column("changes_sha256", sa.String(length=64), nullable=False),
        sa.Column("first_seq", sa.BigInteger(), nullable=False),
        sa.Column("last_seq", sa.BigInteger(), nullable=False),
        sa.Column("stages", sa.String(), nullable=False),
        sa.PrimaryKeyConstraint("version", name=op.f("pk_versions")),
    )
    op.create_table(
        "locations",
        sa.Column("location", sa.Text(), nullable=False),
        sa.Column("fingerprint", sa.String(), nullable=False),
        sa.Column("log_sha256", sa.String(length=64), nullable=True),
        sa.Column("station", sa.String(), nullable=True),
        sa.Column("product", sa.String(), nullable=True),
        sa.Column("started_utc", sa.String(), nullable=True),
        sa.PrimaryKeyConstraint("location", "fingerprint", name=op.f("pk_locations")),
    )
    op.execute(
        "INSERT INTO versions SELECT version, min(changes_sha256), min(first_seq), min(last_seq), min(stages) "
        "FROM solutions GROUP BY version"
    )
    op.execute(
        "INSERT INTO locations SELECT location, fingerprint, log_sha256, station, product, started_utc FROM solutions "
        "WHERE id IN (SELECT max(id) FROM solutions GROUP BY location, fingerprint)"
    )
    sqlite = op.get_bind().dialect.name == "sqlite"
    with op.batch_alter_table("solutions", recreate="always" if sqlite else "never") as batch:

        def add(column: sa.Column[Any], before: str) -> None:
            """Add a column; in SQLite, which reads a row up to the wanted column, before the column `before`."""
            batch.add_column(column, insert_before=before if sqlite else None)

        add(sa.Column("attempt", sa.Integer(), nullable=False, server_default=sa.text("0")), "location")
        add(sa.Column("partial", sa.Boolean(), nullable=False, server_default=sa.false()), "serial")
        add(sa.Column("changed", sa.Boolean()), "serial")
        add(sa.Column("batch", sa.String()), "failed_checks")
        add(sa.Column("slot", sa.String()), "failed_checks")
        batch.drop_column("fingerprint")
        batch.drop_constraint(_UNIQUE, type_="unique")
        batch.create_unique_constraint(_UNIQUE, [*_KEY, "attempt"])
    entry = "json_extract(result, '$.{}')" if sqlite else "result::json->>'{}'"
    batch_id, slot, partial = map(entry.format, ("batch", "slot", "partial"))
    partial = partial if sqlite else f"({partial})::boolean"
    op.execute(f"UPDATE solutions SET batch = {batch_id}, slot = {slot}, partial = coalesce({partial}, false)")
    logged = sa.text("log_sha256 IS NOT NULL")
    op.create_index("ix_runs_logged", "runs", ["revision"], postgresql_where=logged, sqlite_where=logged)


def downgrade() -> None:
    op.drop_index("ix_runs_logged", "runs")
    op.execute("DELETE FROM solutions WHERE attempt > 0")
    with op.batch_alter_table("solutions") as batch:
        batch.drop_constraint(_UNIQUE, type_="unique")
        batch.create_unique_constraint(_UNIQUE, _KEY)
        for name in ("attempt", "partial", "changed", "batch", "slot"):
            batch.drop_column(name)
        batch.add_column(sa.Column("fingerprint", sa.String(), nullable=False, server_default=""))
    op.drop_table("locations")
    op.drop_table("versions")
