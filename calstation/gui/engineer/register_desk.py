"""The registers view at work: what a result wants, what the unit holds, and the write that was asked for."""

from collections.abc import Callable, Mapping
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from calstation.gui.context import AppContext
from calstation.gui.engineer.registers_view import RegistersView
from calstation.gui.widgets.job_watch import JobWatch
from calstation.station.finished import Finished
from calstation.station.hand_registers import UnitRegisters, Wanted, read_unit, wanted_registers, write_unit
from calstation.station.request import RunRequest
from calstation.station.workshop import Job


class RegisterDesk(QObject):
    """Does the view's work; `changed` when something else may be done now.

    request : what would be run now, for its station, product and engineer's name
    """

    changed = Signal()

    def __init__(self, app: AppContext, request: Callable[[], RunRequest], parent: QObject) -> None:
        super().__init__(parent)
        self._app, self._request = app, request
        self._run: Finished | None = None
        self._writing = False
        self.view = RegistersView()
        self._wanting = JobWatch(self)
        self._wanting.done.connect(self._show_wanted)
        self._wanting.failed.connect(self.view.complain)
        self.view.read_wanted.connect(self._read)
        self.view.write_wanted.connect(self._write)
        self.view.watch.done.connect(self._told)
        self.view.watch.failed.connect(lambda _: self.changed.emit())

    def take(self, run: Finished) -> None:
        """Another run is looked at: find what it wants in the registers."""
        self._run = run
        self.view.show_wanted(None)
        if run.result["parameters"]:
            job = self._app.workshop.submit(wanted_registers, self._request(), dict(run.result))
            self._wanting.watch(job)

    def why_not(self) -> str:
        """Why nothing can be written yet, "" where it can."""
        view = self.view
        if view.wanted is None:
            return self.tr("Open a result or finish a run first: its values are what is written.")
        if view.unit is None:
            return self.tr("Read the unit first, so that what changes can be seen.")
        if view.unit.serial != view.wanted.serial:
            return self.tr("Unit {0} is in the fixture, the result is of {1}.").format(
                view.unit.serial, view.wanted.serial
            )
        return "" if view.changes else self.tr("The unit holds these values already.")

    def _show_wanted(self, wanted: Wanted) -> None:
        self.view.show_wanted(wanted)
        self.changed.emit()

    def _read(self) -> None:
        job = self._app.workshop.submit(read_unit, self._request(), self._app.runs_folder, cancellable=False)
        self._begin(job, writing=False)

    def _write(self, values: Mapping[str, float]) -> None:
        assert self._run is not None
        request, result = self._request(), self._run.result
        job = self._app.workshop.submit(
            write_unit,
            request,
            str(result["unit"]["serial"]),
            dict(values),
            Path(result["log"]["file"]).name,
            request.operator or "",
            self._app.runs_folder,
            cancellable=False,
        )
        self._begin(job, writing=True)

    def _begin(self, job: Job, *, writing: bool) -> None:
        self._writing = writing
        self.view.watch.watch(job)
        self.view.begin()
        self.changed.emit()

    def _told(self, unit: UnitRegisters) -> None:
        self.view.show_unit(unit, written=self._writing)
        self._writing = False
        self.changed.emit()
