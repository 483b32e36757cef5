"""Create the tables of the shared database as declared; the next revision must replace this by their old form."""

from uuid import uuid4

from alembic import op
from sqlalchemy import insert

from calstation.database.tables import metadata, revisions

revision = "0001"
down_revision = None

#: Tables of this revision.
_TABLES = [table for table in metadata.sorted_tables if table.name != "trail_heads"]


def upgrade() -> None:
    """Create all tables."""
    metadata.create_all(op.get_bind(), _TABLES)
    op.execute(insert(revisions).values(last=0, database=str(uuid4())))


def downgrade() -> None:
    """Drop all tables."""
    metadata.drop_all(op.get_bind(), _TABLES)
