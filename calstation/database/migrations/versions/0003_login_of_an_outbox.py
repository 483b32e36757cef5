"""Add the login of an outbox; drop the unused time of a copy."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    op.add_column("outboxes", sa.Column("login", sa.String(), nullable=True))
    with op.batch_alter_table("log_copies") as batch_op:
        batch_op.drop_column("archived")


def downgrade() -> None:
    with op.batch_alter_table("log_copies") as batch_op:
        batch_op.add_column(sa.Column("archived", sa.DateTime(timezone=True), nullable=True))
    op.execute("UPDATE log_copies SET archived = CURRENT_TIMESTAMP")
    with op.batch_alter_table("log_copies") as batch_op:
        batch_op.alter_column("archived", nullable=False)
    with op.batch_alter_table("outboxes") as batch_op:
        batch_op.drop_column("login")
