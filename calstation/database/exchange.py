"""Synchronisation of a runs folder with the shared database: sends messages, receives runs and claims units.

Claims warn the operators if two stations have scanned the same unit.
"""

import logging
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from uuid import uuid4

import sqlalchemy as sa
from sqlalchemy.exc import DataError, DBAPIError

from calstation.config import site_folder
from calstation.database.connect import connect, database_reason, failure, sqlstate, without_password
from calstation.database.outbox import Outbox, OutboxMessage
from calstation.database.state import Claim
from calstation.database.tables import claims, log_copies, outboxes, revisions, runs, trail_heads, upsert
from calstation.errors import ConfigurationError, InputError
from calstation.records import (
    DatabaseHead,
    IndexedRun,
    TrailHead,
    TrailState,
    audit_path,
    from_columns,
    store_database_heads,
    verify_trail,
)

logger = logging.getLogger(__name__)

#: Number of runs that are received at once.
_PAGE_SIZE = 500

#: PostgreSQL's codes for a row that is too large for an index, and for a row whose foreign key does not exist.
_TOO_LARGE, _MISSING_RUN = "54000", "23503"

#: Columns of a run that the local index needs; its result JSON stays in the database.
_INDEX_COLUMNS = [column for column in runs.c if column.name != "result"]

#: Time after which a claim ends unless it is renewed, s; longer than the longest pause between two exchanges.
CLAIM_LIFETIME_S = 300.0


class Exchange:
    """Data exchange between one runs folder and the database; the connection stays open between exchanges."""

    def __init__(self, folder: Path, url: str, station: str, claimed: Mapping[str, str | None] = {}) -> None:
        """Create the exchange; `claimed` contains the operator of each unit to claim, by serial number."""
        self._url, self._station = url, station
        #: Units that every exchange claims, as operators by serial number; claims on all other units are released.
        self.claimed = claimed
        self.complete = False  #: Whether the last exchange was complete; if not, the next one continues.
        self._claimed_serials: set[str] = set()  #: Serial numbers of units that are claimed in the database.
        self._engine: sa.Engine | None = None
        self._trail_stamp: tuple[int, int] | None = None  #: Stamp of the audit trail whose head was sent last.
        #: Heads in the database that contradicted this trail, and their stations.
        self._contradicting: dict[TrailHead, str] = {}
        self.created_utc = datetime.now(UTC)  #: Time when this exchange was created.
        self.outbox = Outbox(folder)
        self._index = self.outbox.index

    def exchange(self, within: float = math.inf) -> list[Claim]:
        """Claim units, send all pending messages, receive new runs; return other stations' claims on the units.

        After `within` s, the call ends at the next complete page; `complete` is False if more pages are left. Raises
        ConfigurationError if the database is unreachable or refuses a request, after which the next call continues.
        """
        end = time.monotonic() + within
        engine = None
        try:
            try:
                engine = self._connected()
                self._synchronise(engine)
                self._renew_claims(engine)
            except (ConfigurationError, DBAPIError):
                self.outbox.refresh()  # counts the pending runs
                raise
            self.complete = self._send_all(engine, end) and self._receive(engine, end)
            self._exchange_heads(engine)  # last, because a database without the rights for it still receives the runs
            return other_claims(engine, self.outbox.id)
        except DBAPIError as exc:
            if engine is None:
                raise  # no other statement precedes the connection, which raises ConfigurationError
            self._disconnect()
            raise failure(exc, engine.url) from exc

    def close(self) -> None:
        """Release the claims and close the connection; the next exchange opens a new one."""
        if self._engine is not None and self._claimed_serials:
            with suppress(DBAPIError):  # the claims will expire
                release_units(self._engine, self.outbox.id, self._claimed_serials)
            self._claimed_serials.clear()
        self._disconnect()

    def _disconnect(self) -> None:
        if self._engine is not None:
            self._engine.dispose()
            self._engine = None

    def _connected(self) -> sa.Engine:
        if self._engine is None:
            self._engine = connect(self._url)
        return self._engine

    def _renew_claims(self, engine: sa.Engine) -> None:
        """Claim the current units or renew their claims, and release the claims on previous units.

        A claim of another process on the same folder is not released.
        """
        claimed = dict(self.claimed)
        if previous := self._claimed_serials - claimed.keys():
            release_units(engine, self.outbox.id, previous)
        claim_units(engine, self.outbox.id, self._station, claimed)
        self._claimed_serials = set(claimed)

    def _exchange_heads(self, engine: sa.Engine) -> None:
        """Store the head of the site's audit trail in the database, and the latest heads of all trails locally."""
        trail = audit_path(site_folder())
        status = trail.stat() if trail.exists() else None
        stamp = None if status is None else (status.st_mtime_ns, status.st_size)
        if stamp is not None and stamp != self._trail_stamp:
            with suppress(InputError):  # an unreadable trail does not stop the exchange
                self._contradicting = self._send_head(engine, verify_trail(site_folder()))
            self._trail_stamp = stamp
        latest = sa.select(trail_heads.c.key, sa.func.max(trail_heads.c.lines).label("lines"))
        last = latest.group_by(trail_heads.c.key).subquery()
        is_last = (trail_heads.c.key == last.c.key) & (trail_heads.c.lines == last.c.lines)
        query = sa.select(trail_heads).join(last, is_last).order_by(trail_heads.c.key, trail_heads.c.digest)
        with engine.connect() as connection:
            rows = connection.execute(query).all()
        heads = {TrailHead(row.key, row.lines, row.digest): row.station for row in rows} | self._contradicting
        with suppress(OSError):  # the next exchange tries again
            store_database_heads(self.outbox.folder, [DatabaseHead(head, station) for head, station in heads.items()])

    def _send_head(self, engine: sa.Engine, state: TrailState) -> dict[TrailHead, str]:
        """Store the head of the site's audit trail; return the stored heads that contradict it, and their stations.

        A changed trail is not stored.
        """
        if state.head is None or not state.head.key or state.faults:
            return {}
        of_trail = sa.select(trail_heads).where(trail_heads.c.key == state.head.key)
        with engine.begin() as connection:
            rows = connection.execute(of_trail).all()
            wrong = [row for row in rows if not state.trail.contains(row.lines, row.digest)]
            values = {"outbox": self.outbox.id, **asdict(state.head)}
            if not wrong and not any((row.outbox, row.lines) == (self.outbox.id, state.head.lines) for row in rows):
                values |= {"station": self._station, "stored": database_time(connection)}
                connection.execute(sa.insert(trail_heads).values(values))
        return {TrailHead(row.key, row.lines, row.digest): row.station for row in wrong}

    def _synchronise(self, engine: sa.Engine) -> None:
        """Read the acknowledged stamps from the database if they differ from the copy in the index.

        They differ if the confirmation of a commit was lost, if the index is new, or if the database was replaced or
        restored from a backup. If the database lost messages, all folders receive all runs again.
        """
        known_revision = self.outbox.revision
        with engine.begin() as connection:
            revision = self._register(connection)
            if revision == known_revision:
                return
            if revision < known_revision:
                connection.execute(sa.update(revisions).values(database=str(uuid4())))
            stamps = sa.select(sa.literal("run"), runs.c.name, runs.c.stamp).where(runs.c.outbox == self.outbox.id)
            urls = sa.select(sa.literal("copy"), log_copies.c.name, log_copies.c.url)
            rows = connection.execute(stamps.union_all(urls.where(log_copies.c.outbox == self.outbox.id))).all()
        self.outbox.acknowledge(revision, [(kind, name, stamp) for kind, name, stamp in rows], replace=True)

    def _register(self, connection: sa.Connection) -> int:
        """Register the outbox and its login if necessary; return the revision of the last message that arrived.

        Raises ConfigurationError if the outbox belongs to another login, whose runs this login must not change.
        """
        is_outbox = outboxes.c.id == self.outbox.id
        login = sa.func.current_user() if connection.dialect.name == "postgresql" else sa.null()
        same_login = outboxes.c.login.is_not_distinct_from(login).label("same_login")
        row = connection.execute(sa.select(outboxes.c.revision, outboxes.c.login, same_login).where(is_outbox)).first()
        if row is None:
            values = {"id": self.outbox.id, "station": self._station, "revision": 0, "login": login}
            connection.execute(sa.insert(outboxes).values(values))
            return 0
        if (
            not row.same_login
            and connection.execute(sa.update(outboxes).where(is_outbox).values(login=login)).rowcount == 0
        ):
            database = without_password(connection.engine.url)
            raise ConfigurationError("database.other_login", database=database, login=row.login)
        return int(row.revision)

    def _send_all(self, engine: sa.Engine, end: float) -> bool:
        """Send all messages; return False if some are pending at the time `end`."""
        sent = True
        while sent:
            if not self.outbox.refresh(end):
                return False
            sent = False
            for messages in self.outbox.pages():
                if sent and time.monotonic() >= end:
                    return False
                self._send(engine, messages)
                sent = sent or bool(messages)
        return True

    def _send(self, engine: sa.Engine, messages: Sequence[OutboxMessage]) -> None:
        """Send messages; if the database refuses them, send them one by one and skip refused messages."""
        try:
            self._deliver(engine, messages)
        except DBAPIError as exc:
            if not _is_refusal(exc):
                raise
            if len(messages) > 1:
                for message in messages:
                    self._send(engine, [message])
                return
            logger.warning("run %s is refused and skipped: %s", messages[0].columns["name"], database_reason(exc))
            self.outbox.refuse(messages[0], database_reason(exc))

    def _deliver(self, engine: sa.Engine, messages: Sequence[OutboxMessage]) -> None:
        """Store messages in one transaction, unless another process has sent some since the stamps were read."""
        if not messages:
            return
        unchanged = (outboxes.c.id == self.outbox.id, outboxes.c.revision == self.outbox.revision)
        with engine.connect() as connection:
            revision = _store(connection, self.outbox.id, messages)
            advance = sa.update(outboxes).where(*unchanged).values(revision=revision, station=self._station)
            accepted = bool(connection.execute(advance).rowcount)
            if accepted:
                connection.commit()
        if accepted:
            self.outbox.acknowledge(revision, [(*message.key, message.stamp) for message in messages])
        else:
            self._synchronise(engine)

    def _receive(self, engine: sa.Engine, end: float) -> bool:
        """Receive new and changed runs of other folders; return False if more are left at the time `end`."""
        while True:
            database, cursor = self._index.received()
            with engine.connect() as connection:
                # read first: all revisions up to the last one have been committed
                last, current = connection.execute(sa.select(revisions.c.last, revisions.c.database)).one()
                if current != database or last < cursor:
                    self._index.receive((), "", 0)  # the database was restored or replaced
                    cursor = 0
                if last == cursor:
                    return True
                conditions = (runs.c.revision > cursor, runs.c.outbox != self.outbox.id)
                query = sa.select(*_INDEX_COLUMNS).where(*conditions).order_by(runs.c.revision).limit(_PAGE_SIZE)
                rows = connection.execute(query).all()
            is_full_page = len(rows) == _PAGE_SIZE
            received_revision = rows[-1].revision if is_full_page else max([last, *(row.revision for row in rows)])
            indexed = [_indexed_run(row) for row in rows]
            self._index.receive([run for run in indexed if run is not None], current, received_revision, cursor)
            if is_full_page and time.monotonic() >= end:
                return False


def _store(connection: sa.Connection, outbox: str, messages: Sequence[OutboxMessage]) -> int:
    """Add or replace runs and copies of logs, and store the location of a log's copy in its run.

    Returns the revision of the last message.
    """
    now = int(database_time(connection).timestamp() * 1e6)
    last = sa.case((revisions.c.last < now, now), else_=revisions.c.last) + len(messages)
    last_revision = connection.execute(sa.update(revisions).values(last=last).returning(revisions.c.last)).scalar_one()
    rows: dict[str, list[dict[str, Any]]] = {"run": [], "copy": []}
    locations = []
    for revision, message in enumerate(messages, last_revision - len(messages) + 1):
        row = {"outbox": outbox, **message.columns}
        rows[message.kind].append(row)
        if message.kind == "run":
            row["revision"] = revision
        else:
            locations.append({"run": row["name"], "url": row["url"], "changed": revision})
    # values of the new row
    name, log = (sa.literal_column(f"excluded.{column}", sa.String) for column in ("name", "log"))
    url = sa.select(log_copies.c.url).where(log_copies.c.outbox == outbox, log_copies.c.name == name).scalar_subquery()
    upsert(connection, runs, rows["run"], log=sa.func.coalesce(url, log))
    upsert(connection, log_copies, rows["copy"])
    if locations:
        run = (runs.c.outbox == outbox, runs.c.name == sa.bindparam("run"))
        statement = sa.update(runs).where(*run).values(log=sa.bindparam("url"), revision=sa.bindparam("changed"))
        connection.execute(statement, locations)
    return int(last_revision)


def _is_refusal(error: DBAPIError) -> bool:
    """Return whether the database refuses the content of the messages, so that sending them again would also fail.

    A run may contain characters or numbers that a column does not accept, or a text that is too long for an index. The
    copy of a log is refused if its run was refused.
    """
    return isinstance(error, DataError) or sqlstate(error) in (_TOO_LARGE, _MISSING_RUN)


def _indexed_run(row: sa.Row[Any]) -> IndexedRun | None:
    """Return a run of another folder as a row of the index; None for an unreadable run, which is logged."""
    try:
        run = from_columns(row.name, "", row.content, row.failed_checks, row.parameters, row.numbers)
    except (ValueError, TypeError) as exc:
        logger.warning("run %s of %s cannot be read and is not received: %s", row.name, row.outbox, exc)
        return None
    return replace(run, record=replace(run.record, origin=row.outbox, location=row.log))


def claim_units(engine: sa.Engine, outbox: str, station: str, operators: Mapping[str, str | None]) -> None:
    """Claim units for the station of an outbox, or renew its claims.

    Parameters
    ----------
    engine : engine of the database
    outbox, station : name of the outbox, and name of its station
    operators : operator of each unit by serial number
    """
    if not operators:
        return
    with engine.begin() as connection:
        now = database_time(connection)
        shared = {
            "outbox": outbox,
            "station": station,
            "claimed": now,
            "expires": now + timedelta(seconds=CLAIM_LIFETIME_S),
        }
        rows = [{**shared, "serial": serial, "operator": operator} for serial, operator in operators.items()]
        expired = claims.c.expires <= now
        upsert(connection, claims, rows, claimed=sa.case((expired, now), else_=claims.c.claimed))


def release_units(engine: sa.Engine, outbox: str, serials: Iterable[str]) -> None:
    """Release the claims on units by the station of an outbox."""
    with engine.begin() as connection:
        connection.execute(sa.delete(claims).where(claims.c.outbox == outbox, claims.c.serial.in_(serials)))


def other_claims(engine: sa.Engine, outbox: str) -> list[Claim]:
    """Return the valid claims of other stations on the units that the station of an outbox has claimed.

    If two stations claim a unit simultaneously and then call this function, at least one sees the other's claim.
    """
    with engine.connect() as connection:
        now = database_time(connection)
        claimed_serials = sa.select(claims.c.serial).where(claims.c.outbox == outbox, claims.c.expires > now)
        others = (claims.c.outbox != outbox, claims.c.expires > now, claims.c.serial.in_(claimed_serials))
        rows = connection.execute(sa.select(claims).where(*others).order_by(claims.c.claimed)).all()
    return [Claim(row.serial, row.station, row.operator, _utc(row.claimed)) for row in rows]


def database_time(connection: sa.Connection) -> datetime:
    """Return the time of the database, UTC; for an SQLite file, the time of this computer."""
    if connection.dialect.name == "sqlite":
        return datetime.now(UTC)
    return _utc(connection.execute(sa.select(sa.func.now())).scalar_one())


def _utc(time: datetime) -> datetime:
    """Return a time of the database with its time zone, which SQLite does not store."""
    return time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
