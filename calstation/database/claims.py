"""Claims on units in progress, so that two stations are warned if both have scanned the same unit."""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime, timedelta

from sqlalchemy import Connection, Engine, case, delete, func, select

from calstation.database.state import Claim
from calstation.database.tables import claims, upsert

#: Time after which a claim ends unless it is renewed, s; longer than the longest pause between two exchanges.
EXPIRY_S = 300.0


def claim_units(engine: Engine, outbox: str, station: str, operators: Mapping[str, str | None]) -> None:
    """Claim units for the station of an outbox, or renew its claims; `operators` are given by serial number."""
    if not operators:
        return
    with engine.begin() as connection:
        now = database_time(connection)
        shared = {"outbox": outbox, "station": station, "claimed": now, "expires": now + timedelta(seconds=EXPIRY_S)}
        rows = [{**shared, "serial": serial, "operator": operator} for serial, operator in operators.items()]
        expired = claims.c.expires <= now
        upsert(connection, claims, rows, claimed=case((expired, now), else_=claims.c.claimed))


def release_units(engine: Engine, outbox: str, serials: Iterable[str]) -> None:
    """Release the claims on units by the station of an outbox."""
    with engine.begin() as connection:
        connection.execute(delete(claims).where(claims.c.outbox == outbox, claims.c.serial.in_(serials)))


def other_claims(engine: Engine, outbox: str) -> list[Claim]:
    """Return the valid claims of other stations on the units that the station of an outbox has claimed.

    If two stations claim a unit simultaneously and then call this function, at least one sees the other's claim.
    """
    with engine.connect() as connection:
        now = database_time(connection)
        claimed_serials = select(claims.c.serial).where(claims.c.outbox == outbox, claims.c.expires > now)
        others = (claims.c.outbox != outbox, claims.c.expires > now, claims.c.serial.in_(claimed_serials))
        rows = connection.execute(select(claims).where(*others).order_by(claims.c.claimed)).all()
    return [Claim(row.serial, row.station, row.operator, _utc(row.claimed)) for row in rows]


def database_time(connection: Connection) -> datetime:
    """Return the time of the database, UTC; for an SQLite file, the time of this computer."""
    if connection.dialect.name == "sqlite":
        return datetime.now(UTC)
    return _utc(connection.execute(select(func.now())).scalar_one())


def _utc(time: datetime) -> datetime:
    """Return a time of the database with its time zone, which SQLite does not store."""
    return time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
