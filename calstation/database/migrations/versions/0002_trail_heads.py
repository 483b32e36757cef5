"""Add the heads of audit trails as declared; the next revision must replace this by their old form."""

from alembic import op

from calstation.database.tables import trail_heads

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Create the table."""
    trail_heads.create(op.get_bind())


def downgrade() -> None:
    """Drop the table."""
    trail_heads.drop(op.get_bind())
