"""Create the tables of the shared database."""

from uuid import uuid4

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    op.create_table(
        "claims",
        sa.Column("serial", sa.String(), nullable=False),
        sa.Column("outbox", sa.String(length=36), nullable=False),
        sa.Column("station", sa.String(), nullable=False),
        sa.Column("operator", sa.String(), nullable=True),
        sa.Column("claimed", sa.DateTime(timezone=True), nullable=False),
        sa.Column("expires", sa.DateTime(timezone=True), nullable=False),
        sa.PrimaryKeyConstraint("serial", "outbox", name=op.f("pk_claims")),
    )
    op.create_table(
        "outboxes",
        sa.Column("id", sa.String(length=36), nullable=False),
        sa.Column("station", sa.String(), nullable=False),
        sa.Column("last_number", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_outboxes")),
    )
    op.create_table(
        "revisions",
        sa.Column("last", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("database", sa.String(length=36), nullable=False),
        sa.PrimaryKeyConstraint("last", name=op.f("pk_revisions")),
    )
    op.create_table(
        "solutions",
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), nullable=False),
        sa.Column("log_sha256", sa.String(length=64), nullable=False),
        sa.Column("version", sa.String(), nullable=False),
        sa.Column("configuration_sha256", sa.String(length=64), nullable=False),
        sa.Column("first_seq", sa.BigInteger(), nullable=False),
        sa.Column("last_seq", sa.BigInteger(), nullable=False),
        sa.Column("stages", sa.String(), nullable=False),
        sa.Column("changes_sha256", sa.String(length=64), nullable=False),
        sa.Column("location", sa.Text(), nullable=False),
        sa.Column("fingerprint", sa.String(), nullable=False),
        sa.Column("outcome", sa.String(), nullable=False),
        sa.Column("error_code", sa.String(), nullable=True),
        sa.Column("passed", sa.Boolean(), nullable=True),
        sa.Column("serial", sa.String(), nullable=True),
        sa.Column("product", sa.String(), nullable=True),
        sa.Column("station", sa.String(), nullable=True),
        sa.Column("started_utc", sa.String(), nullable=True),
        sa.Column("failed_checks", sa.Text(), nullable=False),
        sa.Column("parameters", sa.Text(), nullable=False),
        sa.Column("numbers", sa.LargeBinary(), nullable=False),
        sa.Column("solved", sa.DateTime(timezone=True), nullable=False),
        sa.Column("result", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_solutions")),
        sa.UniqueConstraint(
            "log_sha256",
            "version",
            "configuration_sha256",
            "first_seq",
            "last_seq",
            "stages",
            name=op.f("uq_solutions_log_sha256"),
        ),
    )
    with op.batch_alter_table("solutions", schema=None) as batch_op:
        batch_op.create_index("ix_solutions_version", ["version", "id"], unique=False)

    op.create_table(
        "runs",
        sa.Column("outbox", sa.String(length=36), nullable=False),
        sa.Column("name", sa.String(), nullable=False),
        sa.Column("revision", sa.BigInteger(), nullable=False),
        sa.Column("serial", sa.String(), nullable=False),
        sa.Column("started_utc", sa.String(), nullable=False),
        sa.Column("content", sa.Text(), nullable=False),
        sa.Column("failed_checks", sa.Text(), nullable=False),
        sa.Column("parameters", sa.Text(), nullable=False),
        sa.Column("numbers", sa.LargeBinary(), nullable=False),
        sa.Column("result", sa.Text(), nullable=True),
        sa.Column("log_sha256", sa.String(length=64), nullable=True),
        sa.Column("log", sa.Text(), nullable=True),
        sa.ForeignKeyConstraint(["outbox"], ["outboxes.id"], name=op.f("fk_runs_outbox")),
        sa.PrimaryKeyConstraint("outbox", "name", name=op.f("pk_runs")),
        sa.UniqueConstraint("revision", name=op.f("uq_runs_revision")),
    )
    with op.batch_alter_table("runs", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_runs_serial"), ["serial"], unique=False)

    op.create_table(
        "log_copies",
        sa.Column("outbox", sa.String(length=36), nullable=False),
        sa.Column("name", sa.String(), nullable=False),
        sa.Column("url", sa.Text(), nullable=False),
        sa.Column("file_sha256", sa.String(length=64), nullable=False),
        sa.Column("size", sa.BigInteger(), nullable=False),
        sa.Column("archived", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(["outbox", "name"], ["runs.outbox", "runs.name"], name=op.f("fk_log_copies_outbox")),
        sa.PrimaryKeyConstraint("outbox", "name", name=op.f("pk_log_copies")),
    )
    op.execute(f"INSERT INTO revisions (last, database) VALUES (0, '{uuid4()}')")


def downgrade() -> None:
    op.drop_table("log_copies")
    with op.batch_alter_table("runs", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_runs_serial"))

    op.drop_table("runs")
    with op.batch_alter_table("solutions", schema=None) as batch_op:
        batch_op.drop_index("ix_solutions_version")

    op.drop_table("solutions")
    op.drop_table("revisions")
    op.drop_table("outboxes")
    op.drop_table("claims")
