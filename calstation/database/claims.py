"""Claims: which units stations work on, so that two stations that have scanned the same unit are warned."""

from datetime import UTC, datetime, timedelta

from sqlalchemy import Connection, Engine, delete, func, insert, select, update

from calstation.database.state import Claim
from calstation.database.tables import claims

#: Time after which a claim ends unless it is renewed, s; longer than the longest pause between two exchanges.
EXPIRY_S = 300.0


def claim_unit(engine: Engine, outbox: str, station: str, serial: str, operator: str | None) -> None:
    """Claim a unit for the station of an outbox, or renew its claim."""
    with engine.begin() as connection:
        now = _now(connection)
        same = (claims.c.outbox == outbox, claims.c.serial == serial)
        row = {"station": station, "operator": operator, "expires": now + timedelta(seconds=EXPIRY_S)}
        connection.execute(delete(claims).where(*same, claims.c.expires <= now))
        if connection.execute(update(claims).where(*same).values(row)).rowcount == 0:
            connection.execute(insert(claims).values(outbox=outbox, serial=serial, claimed=now, **row))


def release_unit(engine: Engine, outbox: str, serial: str) -> None:
    """End the claim of the station of an outbox on a unit."""
    with engine.begin() as connection:
        connection.execute(delete(claims).where(claims.c.outbox == outbox, claims.c.serial == serial))


def other_claims(engine: Engine, outbox: str) -> list[Claim]:
    """Return the valid claims of other stations on the units that the station of an outbox has claimed.

    Of two stations that claim a unit at once and then ask, at least one sees the other.
    """
    with engine.connect() as connection:
        now = _now(connection)
        mine = select(claims.c.serial).where(claims.c.outbox == outbox, claims.c.expires > now)
        others = (claims.c.outbox != outbox, claims.c.expires > now, claims.c.serial.in_(mine))
        rows = connection.execute(select(claims).where(*others).order_by(claims.c.claimed)).all()
    return [Claim(row.serial, row.station, row.operator, _utc(row.claimed)) for row in rows]


def _now(connection: Connection) -> datetime:
    """Return the time of the database, UTC."""
    return _utc(connection.execute(select(func.now())).scalar_one())


def _utc(time: datetime) -> datetime:
    """Return a time of the database with its zone, which SQLite does not store."""
    return time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
