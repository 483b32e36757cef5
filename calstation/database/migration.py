"""Revisions of the tables of a shared database (Alembic)."""

from pathlib import Path

from sqlalchemy import Connection, Engine

from calstation.errors import ConfigurationError

try:
    import keyring
    import psycopg  # noqa: F401 - used by SQLAlchemy
    from alembic import command
    from alembic.config import Config
    from alembic.runtime.migration import MigrationContext
    from alembic.script import ScriptDirectory
    from alembic.util import CommandError
    from keyring.errors import KeyringError
except ImportError as exc:
    raise ConfigurationError("database.not_installed") from exc


def known_revisions() -> tuple[str | None, set[str | None]]:
    """Return the revision of this version, and all earlier revisions; None means a database without tables."""
    scripts = ScriptDirectory.from_config(_configuration())
    head = scripts.get_current_head()
    return head, {None, *(script.revision for script in scripts.walk_revisions())} - {head}


def revision(engine: Engine) -> str | None:
    """Return the revision of a database's tables; None if there are no tables."""
    with engine.connect() as connection:
        return MigrationContext.configure(connection).get_current_revision()


def upgrade_tables(connection: Connection) -> bool:
    """Upgrade the tables within the transaction of a connection; return whether they changed.

    Raises LookupError if this version does not know their revision.
    """
    configuration = _configuration()
    configuration.attributes["connection"] = connection
    context = MigrationContext.configure(connection)
    before = context.get_current_revision()
    try:
        command.upgrade(configuration, "head")
    except CommandError as exc:
        raise LookupError from exc
    return MigrationContext.configure(connection).get_current_revision() != before


def stored_password(service: str, login: str) -> str | None:
    """Return a password from the system's keyring; None if there is no password or no keyring."""
    try:
        return keyring.get_password(service, login)
    except KeyringError:
        return None


def _configuration() -> Config:
    configuration = Config()
    configuration.set_main_option("script_location", str(Path(__file__).parent / "migrations"))
    return configuration
