"""Script executed by Alembic, which migrates the tables over the connection of `calstation.database.connect`."""

from alembic import context

from calstation.database.tables import metadata

context.configure(connection=context.config.attributes["connection"], target_metadata=metadata, render_as_batch=True)
with context.begin_transaction():
    context.run_migrations()
