"""Detection of other programs on this computer that use the ports of the station."""

import os
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal

from calstation.connection import PortOwner, find_station_owner
from calstation.gui.state.engine_link import EngineLink
from calstation.gui.state.run_status import RunStatus
from calstation.messages import Text

#: Interval at which the locks of the ports are read, ms.
_INTERVAL_MS = 1000
#: Codes of the faults of a run that another program prevented by using a port.
_IN_USE = ("connection.port_in_use", "connection.port_in_use_unknown")


class PortWatch(QObject):
    """Shows the program that uses the devices of the station as `RunStatus.program`, and passes STOP to its run."""

    stopped = Signal(Text)  #: Emitted with a notice when another program's run has ended after STOP in this window.
    freed = Signal()  #: Emitted when the program that prevented the start of a run has ended.
    _read = Signal(object, object)

    def __init__(self, run: RunStatus, link: EngineLink, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._run, self._link = run, link
        self._station: Path | None = None
        self._owner: PortOwner | None = None
        self._effect = ""  #: Effect of STOP on the owner, ``stopping`` or ``not_stopped``; "" before STOP.
        self._reading = False
        self._stop_reads = 0  #: Number of pending reads that stop the owner they find, because STOP was pressed.
        self._stop_since = ""  #: Time at which STOP was pressed, ISO 8601 in UTC.
        self._timer = QTimer(self, interval=_INTERVAL_MS)
        self._timer.timeout.connect(self._find_owner)
        self._read.connect(self._show)
        run.stop_pressed.connect(self._stop)

    def watch(self, station: Path | None) -> None:
        """Watch the ports of a station file; None for the virtual bench, which has no ports."""
        if station != self._station:
            self._station, self._stop_reads = station, 0
            self._set_owner(None)
        self._timer.start()
        self._find_owner()

    def leave(self) -> None:
        """End the watch."""
        self._timer.stop()

    def _find_owner(self) -> None:
        if self._run.in_progress and self._run.commanded:  # the run has locked the ports
            self._stop_reads = 0
            self._set_owner(None)
        elif not self._reading:
            self._reading = True
            find_station_owner(self._station, self._pass_on)

    def _pass_on(self, path: Path | None, owner: PortOwner | None) -> None:
        with suppress(RuntimeError):  # the window has been destroyed
            self._read.emit(path, owner)

    def _show(self, station: Path | None, owner: PortOwner | None) -> None:
        self._reading = False
        stop_reads, self._stop_reads = self._stop_reads, max(self._stop_reads - 1, 0)
        if station == self._station:
            own = owner is not None and os.getpid() in (owner.pid, owner.parent)
            previous, stopping = self._owner, self._effect == "stopping"
            self._set_owner(None if own else owner)
            if stop_reads and self._owner is not None and self._owner.since <= self._stop_since:
                self._stop_owner(self._owner)
            elif stop_reads > 1:
                self._find_owner()
            if previous is not None and stopping and self._owner != previous:
                self.stopped.emit(Text.of("question.program_stopped", pid=previous.pid, user=previous.user))
            request = self._link.request
            # a program that could not be identified may still be running
            known = self._run.fault is not None and self._run.fault.code == "connection.port_in_use"
            if owner is None and known and request is not None and request.station == station:
                self.freed.emit()

    def _set_owner(self, owner: PortOwner | None) -> None:
        if owner != self._owner:
            self._owner, self._effect = owner, ""
            self._show_owner()

    def _stop(self) -> None:
        """Stop the other program's run, even if it locked the ports just before a run that is being started here."""
        if self._run.elsewhere is None and not (self._run.in_progress and self._run.commanded):
            if self._owner is not None:
                self._stop_owner(self._owner)
                return
            self._stop_since = datetime.now(UTC).isoformat(timespec="seconds")
            self._stop_reads = 1 + self._reading  # the current read may have begun before the other program
            self._find_owner()

    def _stop_owner(self, owner: PortOwner) -> None:
        self._stop_reads, self._effect = 0, "stopping" if owner.stop() else "not_stopped"
        self._show_owner()

    def _show_owner(self) -> None:
        owner, program = self._owner, None
        if owner is not None:
            effect = self._effect or ("running" if owner.can_stop else "used")
            program = Text.of(f"question.program_{effect}", pid=owner.pid, user=owner.user, since=owner.since)
        self._run.set_program(program)


def prevented_by(run: RunStatus) -> Text | None:
    """Return the text about the program that prevented the last run and still uses the station, or None."""
    return run.other_program if run.fault is not None and run.fault.code in _IN_USE else None
