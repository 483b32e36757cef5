"""Copies the closed logs of a folder of runs to the archive of the station, one after the other."""

import time
from dataclasses import replace
from pathlib import Path

from calstation.database.archive import archive_log
from calstation.database.outbox import Outbox
from calstation.database.state import read_state, write_state
from calstation.errors import CalstationError
from calstation.records import SUFFIX, RunIndex, being_written, locked

#: Shortest and longest pause after a failure, s.
_FAILED_S, _LONGEST_S = 5.0, 600.0


class LogArchiver:
    """Copies logs and records the copies in the outbox; failures are noted in the state of the exchange."""

    def __init__(self, folder: Path, archive: str) -> None:
        self._folder, self._archive = folder, archive
        self._outbox, self._index = Outbox(folder), RunIndex(folder)
        self._failed: set[str] = set()  #: Names of the logs that failed since the last success.
        self._due, self._pause = 0.0, _FAILED_S

    def copy_next(self) -> bool:
        """Copy the next log, unless another process does so or a failure was too recent; return whether one was copied.

        Raises OSError if the folder cannot be used.
        """
        if time.monotonic() < self._due:
            return False
        try:
            with locked(self._folder / ".archive.lock", 0.0):
                return self._copy_next()
        except TimeoutError:
            return False

    def _copy_next(self) -> bool:
        copied = self._outbox.copies()
        names = sorted(name for name in self._index.stamps() if name not in copied and self._is_closed(name))
        if not names:
            self._note(0, None)
            return False
        # another one after a failure, because a log may be the cause
        name = next((name for name in names if name not in self._failed), None)
        if name is None:
            self._failed.clear()
            name = names[0]
        try:
            copy = archive_log(self._log(name), f"{self._archive.rstrip('/')}/{self._outbox.id}")
            self._outbox.add_copy(name, copy.url, copy.file_sha256, copy.size)
        except CalstationError as error:
            self._failed.add(name)
            self._due, self._pause = time.monotonic() + self._pause, min(2.0 * self._pause, _LONGEST_S)
            self._note(len(names), error)
            return False
        self._failed.clear()
        self._pause = _FAILED_S
        self._note(len(names) - 1, None)
        return True

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}{SUFFIX}"

    def _is_closed(self, name: str) -> bool:
        log = self._log(name)
        try:
            return log.exists() and not being_written(log)
        except CalstationError:  # no log
            return False

    def _note(self, pending: int, error: CalstationError | None) -> None:
        state = read_state(self._folder)
        noted = replace(state, logs_pending=pending, archive_error=None if error is None else error.as_text.to_json())
        if noted != state:
            write_state(self._folder, noted)
