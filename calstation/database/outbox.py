"""Outbox of a runs folder: numbered messages for the shared database, stored on disk until they have arrived.

The folder's files are the source: the queued content is compared with them, so that nothing is lost if a process is
killed between a result and its message.
"""

import json
import math
import socket
import sqlite3
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from uuid import uuid4

from sqlalchemy import (
    Column,
    Connection,
    Engine,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    create_engine,
    delete,
    event,
    exists,
    func,
    insert,
    select,
    text,
    update,
)
from sqlalchemy.exc import DBAPIError
from sqlalchemy.pool import NullPool

from calstation.database.tables import upsert
from calstation.errors import ConfigurationError, InputError
from calstation.messages import Text
from calstation.records import IndexedRun, RunIndex, Verdict, to_columns, write_atomic
from calstation.results import History

#: File name of the outbox in the folder of the runs.
FILE = "outbox.sqlite"

#: File name of the outbox's random name and location, which survive a lost outbox; the history ignores hidden files.
PLACE_FILE = ".outbox.json"

#: Largest number of messages in an outbox; further runs remain in the folder's files until they are queued.
CAPACITY = 1000

#: Number of messages that are written or read together.
_AT_ONCE = 50

#: Longest time to wait for another process that uses the outbox, s.
_BUSY_S = 30.0

_metadata = MetaData()
#: One row: the random name of the outbox, and the number of its last message.
_outbox = Table(
    "outbox",
    _metadata,
    Column("one", Integer, primary_key=True),
    Column("id", String, nullable=False),
    Column("last_number", Integer, nullable=False),
)
#: One row: the number of the last message whose sending has begun. The database has no later messages of this file.
_begun = Table(
    "begun", _metadata, Column("one", Integer, primary_key=True), Column("last_number", Integer, nullable=False)
)
#: Queued content: stamps of runs, and URLs of copies of logs.
_queued = Table(
    "queued",
    _metadata,
    Column("kind", String, primary_key=True),
    Column("name", String, primary_key=True),
    Column("stamp", String, nullable=False),
)
_messages = Table(
    "messages",
    _metadata,
    Column("number", Integer, primary_key=True),
    Column("kind", String, nullable=False),
    Column("content", String, nullable=False),
    Column("numbers", LargeBinary, nullable=False),
)
#: Name of the run that a message refers to.
_name = func.json_extract(_messages.c.content, "$.name")
#: Verified copies of the folder's logs in an archive.
_copies = Table(
    "copies",
    _metadata,
    Column("name", String, primary_key=True),
    Column("url", String, nullable=False),
    Column("file_sha256", String, nullable=False),
    Column("size", Integer, nullable=False),
)


#: Runs that the database refuses in their current state: the last refused message of each.
_refused = Table(
    "refused",
    _metadata,
    Column("name", String, primary_key=True),
    Column("number", Integer, nullable=False),
    Column("reason", String, nullable=False),
)


@dataclass(frozen=True)
class OutboxMessage:
    """A message for the shared database."""

    number: int
    kind: str  #: ``run``, or ``copy`` for the copy of a log.
    columns: Mapping[str, Any]  #: Columns of `tables.runs` or `tables.log_copies` that the station knows.


class Outbox:
    """The outbox of a folder. Only one process at a time may call `fill`."""

    def __init__(self, folder: Path) -> None:
        """Open or create the outbox.

        Raises ConfigurationError if the folder was moved or copied, and, like all methods, if the file cannot be used.
        """
        self._folder, self._path = folder, folder / FILE
        self._engine = _engine(self._path)
        self._beyond = 0  #: Number of runs that `fill` has left to be queued later.
        #: Value of the index's `mark`, and number of queued runs, after all were queued; None before.
        self._compared: tuple[str | None, int] | None = None
        first = text("INSERT OR IGNORE INTO outbox (one, id, last_number) VALUES (1, :id, 0)")
        begun = text("INSERT OR IGNORE INTO begun (one, last_number) SELECT 1, last_number FROM outbox")
        with self._transaction() as connection:
            _metadata.create_all(connection)
            connection.execute(first, {"id": str(uuid4())})  # locks the file
            connection.execute(begun)
            stored: str = connection.execute(select(_outbox.c.id)).scalar_one()
            self.id = self._placed(stored)
            if self.id != stored:
                _forget(connection, 0)
                connection.execute(update(_outbox).values(id=self.id))

    @cached_property
    def index(self) -> RunIndex:
        """Index of the runs of the folder."""
        return RunIndex(self._folder)

    @cached_property
    def _history(self) -> History:
        return History(self._folder, self.index)

    def fill(self, end: float = math.inf) -> bool:
        """Queue new and changed runs and copies, the oldest runs first.

        At most `CAPACITY` messages are pending; the others are queued when these have arrived. Returns False without
        queuing anything if the index of the folder is not up to date at the time `end`, s of the monotonic clock; the
        next call continues.
        """
        for changed, _ in self._history.refresh_in_parts():
            if changed and time.monotonic() >= end:
                return False
        self._queue_runs()
        self._queue_copies()
        return True

    def _queue_runs(self) -> None:
        mark, stamps = self.index.mark, self.index.stamps()
        with self._transaction() as connection:
            if mark is not None and (mark, _queued_runs(connection)) == self._compared:
                return
            query = select(_queued.c.name, _queued.c.stamp).where(_queued.c.kind == "run")
            queued = {row.name: row.stamp for row in connection.execute(query)}
            room = max(0, CAPACITY - _waiting(connection))
        changed = [name for name in stamps if queued.get(name) != stamps[name]]
        self._beyond = max(0, len(changed) - room)
        changed = sorted(changed, key=lambda name: (_file_time(stamps[name]), name))[:room]
        left = len(changed) + self._beyond
        for start in range(0, len(changed), _AT_ONCE):
            runs = {run.name: run for run in self.index.own(changed[start : start + _AT_ONCE])}
            names = [name for name in changed[start : start + _AT_ONCE] if name in runs]
            rows = [_run_row(self._folder, runs[name], self._history) for name in names]
            self._append("run", rows, [stamps[name] for name in names])
            left -= len(names)
        with self._transaction() as connection:
            self._compared = (mark, _queued_runs(connection)) if not left else None

    def _queue_copies(self) -> None:
        """Queue the copies whose runs are queued, unless the database refused the run."""
        run, copy = _queued.alias(), _queued.alias()
        same_run = (run.c.kind == "run") & (run.c.name == _copies.c.name)
        same_copy = (copy.c.kind == "copy") & (copy.c.name == _copies.c.name)
        ready = select(_copies).join(run, same_run).outerjoin(copy, same_copy)
        refused = select(_refused.c.name)
        ready = ready.where(copy.c.stamp.is_distinct_from(_copies.c.url), _copies.c.name.not_in(refused))
        with self._transaction() as connection:
            rows = connection.execute(ready.limit(max(0, CAPACITY - _waiting(connection)))).all()
        self._append("copy", [dict(row._mapping) for row in rows], [row.url for row in rows])

    def add_copy(self, name: str, url: str, file_sha256: str, size: int) -> None:
        """Record the verified copy of the log of a run in an archive; `fill` queues it after its run."""
        row = {"name": name, "url": url, "file_sha256": file_sha256, "size": size}
        with self._transaction() as connection:
            connection.execute(delete(_copies).where(_copies.c.name == name))
            connection.execute(insert(_copies).values(row))

    def copies(self) -> dict[str, str]:
        """Return the URLs of the recorded copies by the names of their runs."""
        with self._transaction() as connection:
            return {row.name: row.url for row in connection.execute(select(_copies))}

    def messages(self, count: int = _AT_ONCE) -> list[OutboxMessage]:
        """Return the first messages to send."""
        query = select(_messages).order_by(_messages.c.number).limit(count)
        with self._transaction() as connection:
            rows = connection.execute(query).all()
            if rows:
                connection.execute(update(_begun).values(last_number=rows[-1].number))
        return [_message(row.number, row.kind, json.loads(row.content), row.numbers) for row in rows]

    def arrived(self, number: int) -> None:
        """Delete the messages up to a number, which have arrived in the database or were refused."""
        later = (_messages.c.kind == "run", _messages.c.number <= number, _messages.c.number > _refused.c.number)
        accepted = exists().where(*later, _name == _refused.c.name)
        with self._transaction() as connection:
            connection.execute(delete(_refused).where(accepted))
            connection.execute(delete(_messages).where(_messages.c.number <= number))

    def refuse(self, message: OutboxMessage, reason: str) -> None:
        """Record that the database refuses a message; the copy of a log is queued again after a change of its run.

        The reason for a refused run is kept if the copy of its log is therefore refused, too.
        """
        name = message.columns["name"]
        with self._transaction() as connection:
            if message.kind == "run":
                connection.execute(delete(_refused).where(_refused.c.name == name))
            row = {"name": name, "number": message.number, "reason": reason}
            connection.execute(insert(_refused).prefix_with("OR IGNORE").values(row))
            connection.execute(delete(_queued).where(_queued.c.kind == "copy", _queued.c.name == name))

    def restart(self, number: int) -> None:
        """Forget the queued content, for a database with other messages; `fill` queues it again from `number` + 1."""
        with self._transaction() as connection:
            _forget(connection, number)

    @property
    def pending(self) -> int:
        """Number of runs whose state at the last `fill` has not arrived."""
        query = select(func.count(_name.distinct())).where(_messages.c.kind == "run")
        with self._transaction() as connection:
            return int(connection.execute(query).scalar_one()) + self._beyond

    @property
    def refusal(self) -> Text | None:
        """Message about runs of the folder that the database refuses; None if there are none."""
        with self._transaction() as connection:
            found = connection.execute(select(_refused).order_by(_refused.c.number)).all()
        rows = [row for row in found if row.name in self.index.stamps()]
        if not rows:
            return None
        values = {"count": len(rows), "run": rows[-1].name, "reason": rows[-1].reason}
        return Text("database.runs_refused", values)

    @property
    def sent(self) -> int:
        """Number of the last message that has arrived."""
        with self._transaction() as connection:
            return int(connection.execute(select(_outbox.c.last_number)).scalar_one()) - _waiting(connection)

    @property
    def begun(self) -> int:
        """Number of the last message whose sending has begun."""
        with self._transaction() as connection:
            return int(connection.execute(select(_begun.c.last_number)).scalar_one())

    def _placed(self, stored: str) -> str:
        """Return the name of the outbox for this location; `stored` is the name in the outbox file."""
        file, (host, folder) = self._folder / PLACE_FILE, _place(self._folder)
        try:
            if not file.exists():
                _write_place(self._folder, stored)
            known = json.loads(file.read_bytes())
            name, *place = str(known["id"]), known["host"], known["folder"]
        except (OSError, ValueError, KeyError, TypeError) as exc:
            raise ConfigurationError("database.outbox_unusable", file=file, reason=str(exc)) from exc
        if place != [host, folder]:
            was = ":".join(map(str, place))
            raise ConfigurationError("database.folder_moved", folder=self._folder, was=was)
        return name

    @contextmanager
    def _transaction(self) -> Iterator[Connection]:
        try:
            with self._engine.begin() as connection:
                yield connection
        except DBAPIError as exc:
            raise ConfigurationError("database.outbox_unusable", file=self._path, reason=str(exc.orig)) from exc

    def _append(self, kind: str, rows: Sequence[Mapping[str, Any]], stamps: Sequence[str]) -> None:
        """Number messages and add them together with the stamps of what they contain."""
        if not rows:
            return
        step = update(_outbox).values(last_number=_outbox.c.last_number + len(rows)).returning(_outbox.c.last_number)
        with self._transaction() as connection:
            first = connection.execute(step).scalar_one() - len(rows) + 1
            messages = [
                {
                    "number": number,
                    "kind": kind,
                    "content": json.dumps({name: value for name, value in row.items() if name != "numbers"}),
                    "numbers": row.get("numbers", b""),
                }
                for number, row in enumerate(rows, first)
            ]
            connection.execute(insert(_messages), messages)
            queued = [
                {"kind": kind, "name": row["name"], "stamp": stamp} for row, stamp in zip(rows, stamps, strict=True)
            ]
            upsert(connection, _queued, queued)


def adopt_folder(folder: Path, *, copied: bool) -> None:
    """Keep the outbox of a runs folder that was moved, or give a copied folder a new outbox.

    Raises ConfigurationError if the folder has no outbox or cannot be written.
    """
    file = folder / PLACE_FILE
    if not file.exists():
        raise ConfigurationError("database.never_exchanged", folder=folder)
    try:
        name = str(json.loads(file.read_bytes())["id"])
        _write_place(folder, str(uuid4()) if copied else name)
    except (OSError, ValueError, KeyError, TypeError) as exc:
        raise ConfigurationError("database.outbox_unusable", file=file, reason=str(exc)) from exc


def _write_place(folder: Path, name: str) -> None:
    host, path = _place(folder)
    write_atomic(folder / PLACE_FILE, json.dumps({"id": name, "host": host, "folder": path}))


def _place(folder: Path) -> tuple[str, str]:
    """Return the computer and the path of a folder."""
    return socket.gethostname(), str(folder.resolve())


def _forget(connection: Connection, number: int) -> None:
    for table in (_messages, _queued, _refused):
        connection.execute(delete(table))
    for table in (_outbox, _begun):
        connection.execute(update(table).values(last_number=number))


def _engine(path: Path) -> Engine:
    engine = create_engine(f"sqlite:///{path}", poolclass=NullPool, connect_args={"timeout": _BUSY_S})

    @event.listens_for(engine, "connect")
    def _prepare(connection: sqlite3.Connection, _: object) -> None:
        connection.execute("PRAGMA synchronous=FULL")  # a message is on disk before its number is used

    return engine


def _waiting(connection: Connection) -> int:
    """Return the number of pending messages."""
    return int(connection.execute(select(func.count()).select_from(_messages)).scalar_one())


def _queued_runs(connection: Connection) -> int:
    """Return the number of runs that were queued."""
    return int(connection.execute(select(func.count()).where(_queued.c.kind == "run")).scalar_one())


def _file_time(stamp: str) -> int:
    """Return the time of change, ns, in a stamp of `RunIndex`."""
    return int(stamp.removeprefix("log ").split()[0])


def _message(number: int, kind: str, columns: dict[str, Any], numbers: bytes) -> OutboxMessage:
    return OutboxMessage(number, kind, {**columns, "numbers": numbers} if kind == "run" else columns)


def _run_row(folder: Path, run: IndexedRun, history: History) -> dict[str, Any]:
    """Return the columns of a run in the shared database."""
    record = run.record
    result = _result_text(run, history)
    content = replace(record, log=Path(record.log.name), result=None)
    return {
        "name": run.name,
        "serial": record.serial,
        "started_utc": record.started_utc,
        **to_columns(replace(run, record=content)),
        "result": result,
        "log_sha256": None if result is None else json.loads(result)["log"].get("sha256"),
        "log": f"{socket.gethostname()}:{(folder / record.log.name).absolute()}",
    }


def _result_text(run: IndexedRun, history: History) -> str | None:
    """Return the result JSON of a run; None for an incomplete run, or if the result cannot be read any more."""
    if run.record.verdict is Verdict.INCOMPLETE and run.record.result is None:
        return None
    try:
        return json.dumps(history.result(run.record).to_json(), allow_nan=False)
    except InputError:
        return None
