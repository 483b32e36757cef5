"""Exchange of a folder of runs with the shared database: sends its messages, receives the runs of other folders."""

import logging
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import uuid4

from sqlalchemy import (
    Connection,
    Engine,
    Row,
    String,
    bindparam,
    case,
    func,
    insert,
    literal,
    literal_column,
    null,
    select,
    update,
)
from sqlalchemy.exc import DataError, DBAPIError

from calstation.database.claims import claim_units, database_time, other_claims, release_units
from calstation.database.connect import connect, failure, public, reason_of, sqlstate
from calstation.database.outbox import Outbox, OutboxMessage
from calstation.database.state import Claim
from calstation.database.tables import log_copies, outboxes, revisions, runs, upsert
from calstation.errors import ConfigurationError
from calstation.records import IndexedRun, from_columns

logger = logging.getLogger(__name__)

#: Number of runs that are received at once.
_PAGE = 500

#: PostgreSQL's codes for a row that is too large for an index, and for a row whose foreign key does not exist.
_TOO_LARGE, _NO_RUN = "54000", "23503"

#: Columns of a run that the local index needs; its result JSON stays in the database.
_INDEXED = [column for column in runs.c if column.name != "result"]


class Exchange:
    """Exchange of one folder; its connection is kept between passes."""

    def __init__(self, folder: Path, url: str, station: str, claimed: Mapping[str, str | None] = {}) -> None:
        """Create the exchange; `claimed` contains the operator of each unit to claim, by serial number."""
        self._url, self._station = url, station
        #: Operators by serial number of the units that every exchange claims, replacing the previous ones.
        self.claimed = claimed
        self.complete = False  #: Whether the last exchange was complete; if not, the next one continues.
        self._held: set[str] = set()  #: Serial numbers of units that are claimed in the database.
        self._engine: Engine | None = None
        self.begun_utc = datetime.now(UTC)  #: Time when this exchange was created.
        self.outbox = Outbox(folder)
        self._index = self.outbox.index

    def exchange(self, within: float = math.inf) -> list[Claim]:
        """Claim units, send all pending messages, receive new runs; return other stations' claims on the units.

        Ends after the first page that completes after `within` s, and sets `complete`. Raises ConfigurationError if the
        database is unreachable or refuses a request; the next call continues in this case, too.
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
            return other_claims(engine, self.outbox.id)
        except DBAPIError as exc:
            if engine is None:
                raise  # no other statement precedes the connection, which raises ConfigurationError
            self._disconnect()
            raise failure(exc, engine.url) from exc

    def close(self) -> None:
        """Release the claims and close the connection; the next exchange opens a new one."""
        if self._engine is not None and self._held:
            with suppress(DBAPIError):  # the claims expire without it
                release_units(self._engine, self.outbox.id, self._held)
            self._held.clear()
        self._disconnect()

    def _disconnect(self) -> None:
        if self._engine is not None:
            self._engine.dispose()
            self._engine = None

    def _connected(self) -> Engine:
        if self._engine is None:
            self._engine = connect(self._url)
        return self._engine

    def _renew_claims(self, engine: Engine) -> None:
        """Claim the current units, or renew their claims, and release the previous ones.

        A claim of another process on the same folder is not released.
        """
        claimed = dict(self.claimed)
        if previous := self._held - claimed.keys():
            release_units(engine, self.outbox.id, previous)
        claim_units(engine, self.outbox.id, self._station, claimed)
        self._held = set(claimed)

    def _synchronise(self, engine: Engine) -> None:
        """Read the acknowledged stamps from the database if they differ from the copy in the index.

        They differ after a commit whose confirmation was lost, in a new index, and if the database was restored from a
        backup or replaced. If the database lost messages, all folders receive all runs again.
        """
        known = self.outbox.revision
        with engine.begin() as connection:
            revision = self._registered(connection)
            if revision == known:
                return
            if revision < known:
                connection.execute(update(revisions).values(database=str(uuid4())))
            stamps = select(literal("run"), runs.c.name, runs.c.stamp).where(runs.c.outbox == self.outbox.id)
            urls = select(literal("copy"), log_copies.c.name, log_copies.c.url)
            rows = connection.execute(stamps.union_all(urls.where(log_copies.c.outbox == self.outbox.id))).all()
        self.outbox.acknowledge(revision, [(kind, name, stamp) for kind, name, stamp in rows], replace=True)

    def _registered(self, connection: Connection) -> int:
        """Return the revision of the last message that arrived; register the outbox and its login if necessary.

        Raises ConfigurationError if the outbox belongs to another login, whose runs this login must not change.
        """
        here = outboxes.c.id == self.outbox.id
        login = func.current_user() if connection.dialect.name == "postgresql" else null()
        own = outboxes.c.login.is_not_distinct_from(login).label("own")
        row = connection.execute(select(outboxes.c.revision, outboxes.c.login, own).where(here)).first()
        if row is None:
            new = {"id": self.outbox.id, "station": self._station, "revision": 0, "login": login}
            connection.execute(insert(outboxes).values(new))
            return 0
        if not row.own and connection.execute(update(outboxes).where(here).values(login=login)).rowcount == 0:
            database = public(connection.engine.url)
            raise ConfigurationError("database.other_login", database=database, login=row.login)
        return int(row.revision)

    def _send_all(self, engine: Engine, end: float) -> bool:
        """Send all messages; return False if some are left at the time `end`."""
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

    def _send(self, engine: Engine, messages: Sequence[OutboxMessage]) -> None:
        """Send messages; if the database refuses one of them, they are sent one by one, and it is skipped."""
        try:
            self._deliver(engine, messages)
        except DBAPIError as exc:
            if not _is_refusal(exc):
                raise
            if len(messages) > 1:
                for message in messages:
                    self._send(engine, [message])
                return
            logger.warning("run %s is refused and skipped: %s", messages[0].columns["name"], reason_of(exc))
            self.outbox.refuse(messages[0], reason_of(exc))

    def _deliver(self, engine: Engine, messages: Sequence[OutboxMessage]) -> None:
        """Store messages in one transaction, unless another process has sent some since the stamps were read."""
        if not messages:
            return
        here = (outboxes.c.id == self.outbox.id, outboxes.c.revision == self.outbox.revision)
        with engine.connect() as connection:
            revision = _store(connection, self.outbox.id, messages)
            step = update(outboxes).where(*here).values(revision=revision, station=self._station)
            are_next = bool(connection.execute(step).rowcount)
            if are_next:
                connection.commit()
        if are_next:
            self.outbox.acknowledge(revision, [(*message.key, message.stamp) for message in messages])
        else:
            self._synchronise(engine)

    def _receive(self, engine: Engine, end: float) -> bool:
        """Receive the runs of other folders that are new or have changed.

        Returns False if there are more at the time `end`.
        """
        database, cursor = self._index.received()
        more = True
        while more:
            with engine.connect() as connection:
                # read first: all revisions up to the last one have been committed
                last, found = connection.execute(select(revisions.c.last, revisions.c.database)).one()
                if found != database or last < cursor:
                    self._index.receive((), "", 0)  # the database was restored or replaced
                    database, cursor = found, 0
                if last == cursor:
                    return True
                wanted = (runs.c.revision > cursor, runs.c.outbox != self.outbox.id)
                query = select(*_INDEXED).where(*wanted).order_by(runs.c.revision).limit(_PAGE)
                rows = connection.execute(query).all()
            more = len(rows) == _PAGE
            reached = rows[-1].revision if more else max([last, *(row.revision for row in rows)])
            if reached > cursor:
                received = [_received(row) for row in rows]
                self._index.receive([run for run in received if run is not None], database, reached)
                cursor = reached
            if more and time.monotonic() >= end:
                return False
        return True


def _store(connection: Connection, outbox: str, messages: Sequence[OutboxMessage]) -> int:
    """Add or replace runs and copies of logs, and store the location of a log's copy in its run.

    Returns the revision of the last message.
    """
    now = int(database_time(connection).timestamp() * 1e6)
    last = case((revisions.c.last < now, now), else_=revisions.c.last) + len(messages)
    last_revision = connection.execute(update(revisions).values(last=last).returning(revisions.c.last)).scalar_one()
    added: dict[str, list[dict[str, Any]]] = {"run": [], "copy": []}
    located = []
    for revision, message in enumerate(messages, last_revision - len(messages) + 1):
        row = {"outbox": outbox, **message.columns}
        added[message.kind].append(row)
        if message.kind == "run":
            row["revision"] = revision
        else:
            located.append({"run": row["name"], "url": row["url"], "changed": revision})
    name, log = literal_column("excluded.name", String), literal_column("excluded.log", String)  # values of the new row
    url = select(log_copies.c.url).where(log_copies.c.outbox == outbox, log_copies.c.name == name).scalar_subquery()
    upsert(connection, runs, added["run"], log=func.coalesce(url, log))
    upsert(connection, log_copies, added["copy"])
    if located:
        run = (runs.c.outbox == outbox, runs.c.name == bindparam("run"))
        note = update(runs).where(*run).values(log=bindparam("url"), revision=bindparam("changed"))
        connection.execute(note, located)
    return int(last_revision)


def _is_refusal(error: DBAPIError) -> bool:
    """Return whether a database refuses the content of messages, so that a repetition would fail, too.

    A run may contain characters or numbers that a column does not accept, or a text that is too long for an index. The
    copy of a log is refused if its run was refused.
    """
    return isinstance(error, DataError) or sqlstate(error) in (_TOO_LARGE, _NO_RUN)


def _received(row: Row[Any]) -> IndexedRun | None:
    """Return a run of another folder as an index row; None for an unreadable run, which is logged."""
    try:
        run = from_columns(row.name, "", row.content, row.failed_checks, row.parameters, row.numbers)
    except (ValueError, TypeError) as exc:
        logger.warning("run %s of %s cannot be read and is not received: %s", row.name, row.outbox, exc)
        return None
    return replace(run, record=replace(run.record, origin=row.outbox, location=row.log))
