"""Exchange of a folder of runs with the shared database: sends its outbox and receives the runs of other folders."""

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

from sqlalchemy import Connection, Engine, Row, func, insert, select, update
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError

from calstation.database.claims import claim_unit, other_claims, release_unit
from calstation.database.connect import connect, public, reason_of
from calstation.database.outbox import Outbox, OutboxMessage
from calstation.database.state import Claim
from calstation.database.tables import log_copies, outboxes, revisions, runs
from calstation.errors import ConfigurationError
from calstation.records import IndexedRun, from_columns

logger = logging.getLogger(__name__)

#: Number of runs that are received at once.
_PAGE = 500

#: Columns of a run that the local index needs; its result JSON stays in the database.
_INDEXED = [column for column in runs.c if column.name != "result"]


class Exchange:
    """Exchange of one folder; it keeps its connection from pass to pass."""

    def __init__(self, folder: Path, url: str, station: str, claimed: Mapping[str, str | None] = {}) -> None:
        """Create the exchange; `claimed` names the operator by serial number of the units to claim."""
        self._url, self._station = url, station
        #: Operator by serial number of the units that every exchange claims, in place of the previous ones.
        self.claimed = claimed
        self._held = set[str]()  #: Serial numbers of the units that are claimed in the database.
        self._engine: Engine | None = None
        self.begun_utc = datetime.now(UTC)  #: Time when this exchange was created.
        self.outbox = Outbox(folder)
        self._index = self.outbox.index

    def exchange(self, within: float = math.inf) -> list[Claim] | None:
        """Send all that is pending, receive what is new, and return other stations' claims on this one's units.

        Ends with the first page after `within` s, and returns None if there is more; the next call continues. Raises
        ConfigurationError if the database is not reachable or refuses something; the next call continues then too.
        """
        end = time.monotonic() + within
        try:
            sent = True
            while sent:
                self.outbox.fill()
                engine = self._connected()
                self._hold(engine)
                self._synchronise(engine)
                sent = False
                while self._send(engine):
                    sent = True
                    if time.monotonic() >= end:
                        return None
            if not self._receive(engine, end):
                return None
            return other_claims(engine, self.outbox.id)
        except DBAPIError as exc:
            lost = isinstance(exc, OperationalError | InterfaceError) or exc.connection_invalidated
            database = "" if self._engine is None else public(self._engine.url)
            self._disconnect()
            if lost:
                raise ConfigurationError("database.unreachable", database=database, reason=reason_of(exc)) from exc
            raise ConfigurationError("database.refused", database=database, reason=reason_of(exc)) from exc

    def close(self) -> None:
        """End the claims and close the connection; the next exchange opens a new one."""
        if self._engine is not None:
            with suppress(DBAPIError):  # the claims end by themselves
                while self._held:
                    release_unit(self._engine, self.outbox.id, self._held.pop())
        self._disconnect()

    def _disconnect(self) -> None:
        if self._engine is not None:
            self._engine.dispose()
            self._engine = None

    def _connected(self) -> Engine:
        if self._engine is None:
            self._engine = connect(self._url)
        return self._engine

    def _hold(self, engine: Engine) -> None:
        """Claim the present units, or renew their claims, and end those on the previous ones.

        A claim of another process on the same folder is not ended.
        """
        claimed = dict(self.claimed)
        for serial in self._held - claimed.keys():
            release_unit(engine, self.outbox.id, serial)
        self._held.clear()
        for serial, operator in claimed.items():
            claim_unit(engine, self.outbox.id, self._station, serial, operator)
            self._held.add(serial)

    def _synchronise(self, engine: Engine) -> None:
        """Take the messages that the database has out of the outbox; queue again what one of the two has lost.

        If the database lost some, it was restored from a backup or replaced, and all folders receive all runs again.
        If it has later ones than the outbox, the outbox was lost or restored: what its later numbers mean is unknown.
        """
        sent, begun = self.outbox.sent, self.outbox.begun
        with engine.begin() as connection:
            here = outboxes.c.id == self.outbox.id
            arrived = connection.execute(select(outboxes.c.last_number).where(here)).scalar() or 0
            if arrived < sent:
                connection.execute(update(revisions).values(database=str(uuid4())))
        if not sent <= arrived <= begun:
            self.outbox.restart(arrived)
            self.outbox.fill()
        else:
            self.outbox.arrived(arrived)

    def _send(self, engine: Engine) -> bool:
        """Send the first messages in one transaction; return whether there were any.

        The database counts the messages of each outbox, so that one whose arrival was not noticed is not repeated.
        """
        messages = self.outbox.messages()
        if not messages:
            return False
        last = messages[-1].number
        with engine.begin() as connection:
            in_order = self._advance(connection, messages[0].number - 1, last)
            if in_order:
                _store(connection, self.outbox.id, messages)
        if in_order:
            self.outbox.arrived(last)
        else:
            self._synchronise(engine)
        return True

    def _advance(self, connection: Connection, before: int, last: int) -> bool:
        """Set the last number of the outbox, which locks its row; return False unless it was `before`."""
        here = outboxes.c.id == self.outbox.id
        values = {"last_number": last, "station": self._station}
        step = update(outboxes).where(here, outboxes.c.last_number == before).values(values)
        if connection.execute(step).rowcount:
            return True
        if before or connection.execute(select(outboxes.c.id).where(here)).first():
            return False
        connection.execute(insert(outboxes).values(id=self.outbox.id, **values))
        return True

    def _receive(self, engine: Engine, end: float) -> bool:
        """Receive the runs of other folders that are new or have changed; return False if there are more at `end`."""
        database, cursor = self._index.received()
        more = True
        while more:
            with engine.connect() as connection:
                # read first: all revisions up to the last one have been committed
                last, found = connection.execute(select(revisions.c.last, revisions.c.database)).one()
                if found != database or last < cursor:
                    self._index.receive((), "", 0)  # a database that was restored or replaced
                    database, cursor = found, 0
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


def _store(connection: Connection, outbox: str, messages: Sequence[OutboxMessage]) -> None:
    step = update(revisions).values(last=revisions.c.last + len(messages)).returning(revisions.c.last)
    revision = connection.execute(step).scalar_one() - len(messages)
    for message in messages:
        revision += 1
        store = _store_run if message.kind == "run" else _store_copy
        store(connection, outbox, revision, dict(message.columns))


def _store_run(connection: Connection, outbox: str, revision: int, columns: dict[str, Any]) -> None:
    """Add or replace a run."""
    same = (runs.c.outbox == outbox, runs.c.name == columns["name"])
    copy = (log_copies.c.outbox == outbox, log_copies.c.name == columns["name"])
    url = connection.execute(select(log_copies.c.url).where(*copy)).scalar()
    columns = {**columns, "log": url or columns["log"], "revision": revision}
    if connection.execute(update(runs).where(*same).values(columns)).rowcount == 0:
        connection.execute(insert(runs).values(outbox=outbox, **columns))


def _store_copy(connection: Connection, outbox: str, revision: int, columns: dict[str, Any]) -> None:
    """Add or replace the copy of a log, and note in its run where it is."""
    same = (log_copies.c.outbox == outbox, log_copies.c.name == columns["name"])
    row = {**columns, "archived": func.now()}
    if connection.execute(update(log_copies).where(*same).values(row)).rowcount == 0:
        connection.execute(insert(log_copies).values(outbox=outbox, **row))
    run = (runs.c.outbox == outbox, runs.c.name == columns["name"])
    connection.execute(update(runs).where(*run).values(log=columns["url"], revision=revision))


def _received(row: Row[Any]) -> IndexedRun | None:
    """Return a run of another folder as it is indexed; None for one that cannot be read, which is logged."""
    try:
        run = from_columns(row.name, "", row.content, row.failed_checks, row.parameters, row.numbers)
    except (ValueError, TypeError) as exc:
        logger.warning("run %s of %s cannot be read and is not received: %s", row.name, row.outbox, exc)
        return None
    return replace(run, record=replace(run.record, origin=row.outbox, location=row.log))
