"""Messages from a runs folder to the shared database about runs and log copies not yet acknowledged by the database.

There is no queue. Each pass compares the folder's runs with the stamps stored in the database, so that nothing is lost
if a process is killed, and nothing is sent twice. The index of the folder keeps a copy of the acknowledged stamps,
which is read again from the database whenever the revisions of the two differ.
"""

import json
import math
import socket
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from uuid import uuid4

from calstation.errors import ConfigurationError, InputError
from calstation.messages import Text
from calstation.parsing import parse_json, read_json
from calstation.records import ChainedFile, IndexedRun, RunIndex, RunRecord, Verdict, locked, to_columns, write_atomic
from calstation.results import History

#: File with the random name and the location of the outbox; the history ignores hidden files.
LOCATION_FILE = ".outbox.json"

#: The file, and a copy in case it is damaged, because the database would take a new name for another folder.
_FILES = (LOCATION_FILE, ".outbox-copy.json")

#: Lock for the creation of the file, and the longest time to wait for it, s.
_LOCK, _LOCK_TIMEOUT_S = ".outbox.lock", 10.0

#: File name of the record of log copies in an archive.
COPIES_FILE = ".copies.jsonl"

#: Number of messages that are sent together.
_MAX_MESSAGES = 50


@dataclass(frozen=True)
class ArchivedLog:
    """A verified copy of the log of a run in an archive."""

    name: str  #: File name of the log without suffix.
    url: str  #: URL, or absolute path.
    file_sha256: str  #: Digest of the file.
    size: int  #: Number of bytes.


@dataclass(frozen=True)
class OutboxMessage:
    """A message for the shared database."""

    kind: str  #: ``run``, or ``copy`` for the copy of a log.
    stamp: str  #: Stamp of the run's files, or URL of the log's copy.
    columns: Mapping[str, Any]  #: Columns of `tables.runs` or `tables.log_copies` that the station provides.

    @property
    def key(self) -> tuple[str, str]:
        """Kind of the message and name of the run."""
        return self.kind, self.columns["name"]


class Outbox:
    """The outbox of a folder. Only one process at a time may send its messages."""

    def __init__(self, folder: Path) -> None:
        """Open the outbox. Raises ConfigurationError if the folder was moved or copied, or cannot be used."""
        self.folder = folder
        self._to_send: list[str] = []  #: Names of the runs to send, the oldest first.
        #: Value of the index's `change_token` and revision when all messages had been sent; None before.
        self._compared: tuple[str | None, int] | None = None
        #: Stamps and reasons of messages that the database refused; the next process sends them again.
        self._refused: dict[tuple[str, str], tuple[str, str]] = {}
        self._acknowledged: tuple[int, dict[tuple[str, str], str]] = (0, {})
        self._copies = ChainedFile[ArchivedLog](folder / COPIES_FILE, ArchivedLog)
        self._copies_read: tuple[int, dict[str, ArchivedLog]] = (0, {})
        self.id = self._read_id()

    def _read_id(self) -> str:
        """Return the random name of the outbox; create it if it is missing."""
        if not any((self.folder / name).exists() for name in _FILES):
            try:
                with locked(self.folder / _LOCK, _LOCK_TIMEOUT_S):  # the window and a run may start at the same time
                    if not any((self.folder / name).exists() for name in _FILES):
                        _write_location(self.folder, str(uuid4()), *_location(self.folder))
            except OSError as exc:
                file = self.folder / LOCATION_FILE
                raise ConfigurationError("database.outbox_unusable", file=file, reason=str(exc)) from exc
        name, *stored = _read_location(self.folder)
        if stored != [*_location(self.folder)]:
            raise ConfigurationError("database.folder_moved", folder=self.folder, was=":".join(stored))
        return name

    @cached_property
    def index(self) -> RunIndex:
        """Index of the runs of the folder."""
        return RunIndex(self.folder)

    @cached_property
    def _history(self) -> History:
        return History(self.folder, self.index)

    def refresh(self, end: float = math.inf) -> bool:
        """Determine the runs to send.

        Returns False if the index of the folder is not up to date when the monotonic clock reaches `end`, s; the next
        call continues.
        """
        for changed, _ in self._history.refresh_in_parts():
            if changed and time.monotonic() >= end:
                return False
        acknowledged, token = self._stamps(), self.index.change_token
        if token is None or (token, self.revision) != self._compared:
            stamps = self.index.stamps()
            names = [name for name, stamp in stamps.items() if acknowledged.get(("run", name)) != stamp]
            names = [name for name in names if not self._is_refused("run", name, stamps[name])]
            self._to_send = sorted(names, key=lambda name: (_file_time(stamps[name]), name))
            self._compared = None if names else (token, self.revision)
        return True

    def pages(self) -> Iterator[list[OutboxMessage]]:
        """Yield pages of the messages to send after `refresh`: first the runs, then the log copies of sent runs."""
        while names := self._to_send[:_MAX_MESSAGES]:
            runs = {run.name: run for run in self.index.runs_by_name(names)}
            messages = [(runs[name].record, self._run_message(runs[name])) for name in names if name in runs]
            # files may be removed after `refresh`; the run is sent when they are restored
            yield [message for record, message in messages if not record.missing and _has_files(record)]
            self._to_send = self._to_send[_MAX_MESSAGES:]
        stamps = self._stamps()
        try:
            copied = self.copies()
        except InputError:
            copied = {}  # the archiver reports the error, and the runs are exchanged nevertheless
        copies = [
            OutboxMessage("copy", copy.url, asdict(copy))
            for name, copy in copied.items()
            if ("run", name) in stamps
            and stamps.get(("copy", name)) != copy.url
            and not self._is_refused("copy", name, copy.url)
        ]
        for start in range(0, len(copies), _MAX_MESSAGES):
            yield copies[start : start + _MAX_MESSAGES]

    @property
    def revision(self) -> int:
        """Revision of the last message that the database has acknowledged."""
        return self.index.acknowledged_revision()

    def acknowledge(self, revision: int, stamps: Iterable[tuple[str, str, str]], *, replace: bool = False) -> None:
        """Record the stamps of messages that the database has received.

        Parameters
        ----------
        revision : revision of the last message that the database has received
        stamps : kind, name and stamp of the received messages
        replace : whether all other stamps are removed
        """
        self.index.acknowledge(revision, stamps, replace=replace)

    def _stamps(self) -> dict[tuple[str, str], str]:
        """Return the acknowledged stamps by kind and name."""
        if self._acknowledged[0] != self.revision:
            self._acknowledged = self.revision, self.index.acknowledged()
        return self._acknowledged[1]

    def add_copy(self, copy: ArchivedLog) -> None:
        """Record the verified copy of the log of a run; it is sent after its run. Raises OSError."""
        with self._copies.locked():
            self._copies.append(asdict(copy))

    def copies(self) -> dict[str, ArchivedLog]:
        """Return the recorded copies by the names of their runs. Raises InputError."""
        size = self._copies.path.stat().st_size if self._copies.path.exists() else 0
        if size != self._copies_read[0]:
            copies = self._copies.entries("database.copies_damaged")
            self._copies_read = size, {copy.name: copy for copy in copies}
        return self._copies_read[1]

    def refuse(self, message: OutboxMessage, reason: str) -> None:
        """Record that the database refused a message, which is sent again only after it has changed."""
        self._refused[message.key] = (message.stamp, reason)

    def _is_refused(self, kind: str, name: str, stamp: str) -> bool:
        return self._refused.get((kind, name), ("", ""))[0] == stamp

    @property
    def pending(self) -> int:
        """Number of runs determined by the last `refresh` that the database has not received."""
        return len(self._to_send)

    @property
    def refusal(self) -> Text | None:
        """Message about runs of the folder that the database refuses; None if there are none."""
        stamps = self.index.stamps()
        reasons = {
            name: reason
            for (kind, name), (stamp, reason) in self._refused.items()
            if name in stamps and (kind == "copy" or stamps[name] == stamp)
        }
        if not reasons:
            return None
        name, reason = list(reasons.items())[-1]
        return Text("database.runs_refused", {"count": len(reasons), "run": name, "reason": reason})

    def _run_message(self, run: IndexedRun) -> OutboxMessage:
        record, result = run.record, _result_text(run, self._history)
        content = replace(record, log=Path(record.log.name), result=None)
        columns = {
            "name": run.name,
            "stamp": run.stamp,
            "serial": record.serial,
            "started_utc": record.started_utc,
            **to_columns(replace(run, record=content)),
            "result": result,
            "log_sha256": None if result is None else parse_json(result)["log"].get("sha256"),
            "log": f"{socket.gethostname()}:{(self.folder / record.log.name).absolute()}",
        }
        return OutboxMessage("run", run.stamp, columns)


def adopt_folder(folder: Path, *, copied: bool) -> None:
    """Keep the outbox of a runs folder that was moved, or give a copied folder a new outbox.

    Raises ConfigurationError if the folder has no outbox or cannot be written.
    """
    if not any((folder / file).exists() for file in _FILES):
        raise ConfigurationError("database.never_exchanged", folder=folder)
    name, *_ = _read_location(folder)
    try:
        _write_location(folder, str(uuid4()) if copied else name, *_location(folder))
    except OSError as exc:
        raise ConfigurationError("database.outbox_unusable", file=folder / LOCATION_FILE, reason=str(exc)) from exc


def _read_location(folder: Path) -> tuple[str, str, str]:
    """Return the name of the outbox, its computer and its folder; a damaged file is restored from its copy.

    Raises ConfigurationError if neither the file nor its copy can be read.
    """
    readable: list[tuple[str, str, str]] = []
    failures: list[Exception] = []
    for file in _FILES:
        try:
            content = read_json(folder / file)
            readable.append((str(content["id"]), str(content["host"]), str(content["folder"])))
        except (OSError, ValueError, KeyError, TypeError) as exc:
            failures.append(exc)
    if not readable:
        raise ConfigurationError("database.outbox_unusable", file=folder / LOCATION_FILE, reason=str(failures[0]))
    if failures or readable[0] != readable[1]:
        with suppress(OSError):  # the next exchange restores the file
            _write_location(folder, *readable[0])
    return readable[0]


def _write_location(folder: Path, name: str, host: str, path: str) -> None:
    for file in _FILES:
        write_atomic(folder / file, json.dumps({"id": name, "host": host, "folder": path}))


def _location(folder: Path) -> tuple[str, str]:
    """Return the computer and the path of a folder."""
    return socket.gethostname(), str(folder.resolve())


def _file_time(stamp: str) -> int:
    """Return the time of change, ns, in a stamp of `RunIndex`."""
    return int(stamp.removeprefix("log ").split()[0])


def _has_files(record: RunRecord) -> bool:
    """Return whether the log or the result file of a run exists."""
    return any(path is not None and path.exists() for path in (record.log, record.result))


def _result_text(run: IndexedRun, history: History) -> str | None:
    """Return the result JSON of a run; None if the run is incomplete or its result can no longer be read."""
    if run.record.verdict is Verdict.INCOMPLETE and run.record.result is None:
        return None
    try:
        return json.dumps(history.result(run.record).to_json(), allow_nan=False)
    except InputError:
        return None
