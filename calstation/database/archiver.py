"""Archiver that copies the closed logs of a runs folder to the station's archive, one at a time."""

from pathlib import Path

from calstation.database.outbox import Outbox
from calstation.database.state import change_state
from calstation.errors import CalstationError
from calstation.records import SUFFIX, being_written, locked


class LogArchiver:
    """Copies logs and records the copies in the folder; failures are recorded in the state of the exchange."""

    def __init__(self, folder: Path, archive: str) -> None:
        self._folder, self._archive = folder, archive
        self._outbox = Outbox(folder)
        self._uncopied_logs: list[str] = []  #: Names of closed logs that are not in the archive.
        self._failed: set[str] = set()  #: Names of logs that could not be copied since the last success.
        #: Value of the index's `change_token` when every log was closed and copied; None before.
        self._idle_token: str | None = None

    def copy_next(self) -> bool:
        """Copy the next log, unless another process is copying; return whether a log was copied.

        Raises CalstationError if the copy fails, after which the next call tries another log if there is one, and
        OSError if the folder cannot be used.
        """
        try:
            with locked(self._folder / ".archive.lock", 0.0):
                return self._copy_next()
        except TimeoutError:
            return False

    def _copy_next(self) -> bool:
        self._uncopied_logs = self._uncopied_logs or self._find_uncopied()
        if not self._uncopied_logs:
            self._record_state(None)
            return False
        from calstation.database.archive import archive_log  # needs an optional dependency

        name = self._uncopied_logs[0]
        try:
            self._outbox.add_copy(archive_log(self._log(name), self._archive, self._outbox.id))
        except CalstationError as error:
            self._failed.add(name)
            self._record_state(error)
            self._uncopied_logs.clear()
            raise
        self._failed.clear()
        del self._uncopied_logs[0]
        self._record_state(None)
        return True

    def _find_uncopied(self) -> list[str]:
        """Return the closed logs that are not in the archive; after a failure, other logs come first.

        Each log must be opened to determine whether a run is writing it. The list is therefore kept until it is
        exhausted or a copy fails. If it is empty and no log is being written, it is rebuilt only after a change of the
        index.
        """
        token = self._outbox.index.change_token
        if token is not None and token == self._idle_token:
            return []
        copied = self._outbox.copies()
        logs = [name for name in self._outbox.index.stamps() if name not in copied and self._log(name).exists()]
        names = sorted(name for name in logs if self._is_closed(name))
        self._idle_token = None if logs else token
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

    def _record_state(self, error: CalstationError | None) -> None:
        text = None if error is None else error.as_text
        change_state(self._folder, logs_pending=len(self._uncopied_logs), archive_error=text)
