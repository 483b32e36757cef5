"""Copying of the closed logs of a runs folder to the station's archive, one at a time."""

from pathlib import Path

from calstation.database.outbox import ArchivedLog, Outbox
from calstation.database.state import change_state
from calstation.errors import CalstationError
from calstation.records import SUFFIX, being_written, locked


class LogArchiver:
    """Copies logs and records the copies in the folder; failures are recorded in the state of the exchange."""

    def __init__(self, folder: Path, archive: str) -> None:
        self._folder, self._archive = folder, archive
        self._outbox = Outbox(folder)
        self._waiting: list[str] = []  #: Names of closed logs that are not in the archive.
        self._failed: set[str] = set()  #: Names of logs that failed since the last success.
        #: Value of the index's `mark` when nothing was left to copy or to be closed; None before.
        self._done: str | None = None

    def copy_next(self) -> bool:
        """Copy the next log, unless another process does so; return whether one was copied.

        Raises CalstationError if the copy fails, after which the next call tries another log if there is one, and
        OSError if the folder cannot be used.
        """
        try:
            with locked(self._folder / ".archive.lock", 0.0):
                return self._copy_next()
        except TimeoutError:
            return False

    def _copy_next(self) -> bool:
        self._waiting = self._waiting or self._uncopied()
        if not self._waiting:
            self._note(None)
            return False
        from calstation.database.archive import archive_log  # the libraries of an extra

        name = self._waiting[0]
        try:
            copy = archive_log(self._log(name), self._archive, self._outbox.id)
            self._outbox.add_copy(ArchivedLog(name, copy.url, copy.file_sha256, copy.size))
        except CalstationError as error:
            self._failed.add(name)
            self._note(error)
            self._waiting.clear()
            raise
        self._failed.clear()
        del self._waiting[0]
        self._note(None)
        return True

    def _uncopied(self) -> list[str]:
        """Return the closed logs that are not in the archive; after a failure, other logs come first.

        Each log must be opened to determine whether a run is writing it. The list is therefore kept until it is
        exhausted or a copy fails. If it is empty and no log is being written, it is rebuilt only after a change of the
        index.
        """
        mark = self._outbox.index.mark
        if mark is not None and mark == self._done:
            return []
        copied = self._outbox.copies()
        logs = [name for name in self._outbox.index.stamps() if name not in copied and self._log(name).exists()]
        names = sorted(name for name in logs if self._is_closed(name))
        self._done = None if logs else mark
        if self._failed.issuperset(names):
            self._failed.clear()
        return sorted(names, key=lambda name: (name in self._failed, name))

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}{SUFFIX}"

    def _is_closed(self, name: str) -> bool:
        try:
            return not being_written(self._log(name))
        except CalstationError:  # not a log
            return False

    def _note(self, error: CalstationError | None) -> None:
        what = None if error is None else error.as_text.to_json()
        change_state(self._folder, logs_pending=len(self._waiting), archive_error=what)
