"""Claims: which units stations work on, so that two stations that have scanned the same unit are told."""

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

from sqlalchemy import Connection, Engine, delete, func, insert, select, update
from sqlalchemy.exc import DBAPIError

from calstation.config import load_station
from calstation.database.outbox import Outbox
from calstation.database.state import Claim
from calstation.database.tables import claims
from calstation.errors import ConfigurationError
from calstation.jobs import ProgressCallback

#: Time after which a claim ends unless the unit's run has arrived before, s.
EXPIRY_S = 2 * 3600.0


def claim_unit(engine: Engine, outbox: str, station: str, serial: str, operator: str | None) -> list[Claim]:
    """Claim a unit for the station of an outbox, and return the valid claims of other stations on it."""
    with engine.begin() as connection:
        now = _now(connection)
        same = (claims.c.outbox == outbox, claims.c.serial == serial)
        until = now + timedelta(seconds=EXPIRY_S)
        row = {"station": station, "operator": operator, "claimed": now, "expires": until}
        if connection.execute(update(claims).where(*same).values(row)).rowcount == 0:
            connection.execute(insert(claims).values(outbox=outbox, serial=serial, **row))
    # after the commit: of two stations at once, at least one sees the other; the exchange tells the other one
    return [claim for claim in other_claims(engine, outbox) if claim.serial == serial]


def claim_scanned(
    report: ProgressCallback, station: Path | None, folder: Path, serial: str, operator: str | None
) -> list[Claim]:
    """Job: claim a scanned unit in the database of a station, and return the claims of other stations on it.

    Parameters
    ----------
    report : progress callback of the job
    station : station file; without a shared database there are no claims
    folder : runs folder of the station
    serial : serial number of the unit
    operator : name for the other stations

    Raises
    ------
    ConfigurationError : if the database cannot be used; the unit may be calibrated all the same.
    """
    _, config = load_station(station)
    if config.records.database is None:
        return []
    outbox = Outbox(folder).id
    report(0.3)
    with _connected(config.records.database) as engine:
        return claim_unit(engine, outbox, config.name, serial, operator)


def release_scanned(report: ProgressCallback, station: Path | None, folder: Path, serial: str) -> None:
    """Job: end a station's claim on a unit. Raises ConfigurationError if the database cannot be used."""
    _, config = load_station(station)
    if config.records.database is None:
        return
    outbox = Outbox(folder).id
    report(0.3)
    with _connected(config.records.database) as engine, engine.begin() as connection:
        connection.execute(delete(claims).where(claims.c.outbox == outbox, claims.c.serial == serial))


@contextmanager
def _connected(url: str) -> Iterator[Engine]:
    from calstation.database.connect import connect, public, reason_of  # not in the window, which names the jobs

    engine = connect(url)
    try:
        yield engine
    except DBAPIError as exc:
        raise ConfigurationError("database.unreachable", database=public(engine.url), reason=reason_of(exc)) from exc
    finally:
        engine.dispose()


def other_claims(engine: Engine, outbox: str) -> list[Claim]:
    """Return the valid claims of other stations on the units that the station of an outbox has claimed."""
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
