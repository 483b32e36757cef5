"""Reads and writes the unit's registers for the registers view."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from calstation.config import RegisterOperation, RunRequest
from calstation.errors import CalstationError
from calstation.gui.engineer.registers_view import RegistersView
from calstation.gui.shell import AppContext
from calstation.gui.text import error_text, event_sentence, fault_text, say, step_sentence
from calstation.gui.widgets import JobWatch
from calstation.registers import TargetRegisters, UnitRegisters, read_unit, wanted_registers
from calstation.results import FinishedRun
from calstation.sequencer import Event, Fault, Message, Settled, StepStarted

#: Stands for the unit in a request while no serial number is given.
UNNAMED = "-"

#: Events that tell in which state an incomplete write has left the unit.
_INCOMPLETE = ("transfer_unproved", "old_unproved")


class RegisterController(QObject):
    """Reads as a job and writes by the engine; emits `changed` when other actions may have become possible.

    Parameters
    ----------
    request : gives the request of a run as chosen now, for its station, product and engineer
    """

    changed = Signal()

    def __init__(self, app: AppContext, request: Callable[[], RunRequest], parent: QObject) -> None:
        super().__init__(parent)
        self._app, self._request = app, request
        self._run: FinishedRun | None = None
        self._operation: RegisterOperation | None = None
        #: The last event of `_INCOMPLETE` of the present write.
        self._incomplete = ""
        self.view = RegistersView()
        self._target_watch = JobWatch(self)
        self._target_watch.done.connect(self._show_target)
        self._target_watch.failed.connect(self._failed)
        self.view.read_wanted.connect(self._read)
        self.view.write_wanted.connect(self._write)
        self.view.watch.done.connect(self._show_unit)
        self.view.watch.failed.connect(self._failed)
        app.engine_link.event.connect(self._follow)
        app.product_changed.connect(self._product_changed)

    def show_run(self, run: FinishedRun) -> None:
        """Find the registers that a run's result asks for."""
        self._run = run
        self.view.show_target(None)
        if run.result.parameters:
            job = self._app.job_queue.submit(wanted_registers, self._request(), run.result)
            self._target_watch.watch(job)

    def why_not_write(self) -> str:
        """Why nothing can be written yet, "" if it can."""
        view = self.view
        if view.target is None:
            return say("engineer.no_target")
        if view.unit is None:
            return say("engineer.no_unit")
        named = self._request().serial
        for serial in (view.unit.serial, view.unit.serial if named == UNNAMED else named):
            if serial != view.target.serial:
                return say("engineer.other_unit", found=serial, wanted=view.target.serial)
        return "" if view.changes else say("engineer.nothing_to_write")

    def _product_changed(self) -> None:
        """The registers depend on the product's profile: find them again."""
        if self._run is not None and self._operation is None:
            self.show_run(self._run)

    def _show_target(self, target: TargetRegisters) -> None:
        self.view.show_target(target)
        self.changed.emit()

    def _read(self) -> None:
        job = self._app.job_queue.submit(read_unit, self._request(), self._app.runs_folder, cancellable=False)
        self.view.watch.watch(job)
        self.view.begin()
        self.changed.emit()

    def _show_unit(self, unit: UnitRegisters) -> None:
        self.view.show_unit(unit)
        self.changed.emit()

    def _failed(self, error: CalstationError) -> None:
        self.view.show_error(lambda: error_text(error).sentences)
        self.changed.emit()

    def _write(self, values: Mapping[str, float], at_rest: bool) -> None:
        assert self._run is not None
        if self._app.job_queue.at_device:
            self.view.show_error(lambda: say("engineer.device_busy"))
            return
        result = self._run.result
        self._operation = RegisterOperation(
            replace(self._request(), serial=result.serial),
            "write",
            dict(values),
            Path(result.log.file).name,
            at_rest=at_rest,
        )
        self._incomplete = ""
        self.view.begin()
        self.view.show_progress(lambda: say("engineer.write_starting"))
        self._app.engine_link.start(self._operation)

    def _follow(self, event: Event) -> None:
        """Show the progress and the end of the present write."""
        if self._operation is None or self._app.engine_link.operation is not self._operation:
            return
        if isinstance(event, Message):
            if event.id in _INCOMPLETE:
                self._incomplete = event.id
            self.view.show_progress(lambda: event_sentence(event.id, event.values))
        elif isinstance(event, StepStarted):
            self.view.show_progress(lambda: step_sentence(event.kind, event.label))
        elif isinstance(event, Settled | Fault):
            self._operation = None
            self._show_end(event)
            self.changed.emit()

    def _show_end(self, event: Settled | Fault) -> None:
        incomplete = self._incomplete
        if isinstance(event, Fault):
            self.view.show_error(lambda: fault_text(event).sentences)
        elif event.closing != "stopped":
            self.view.show_unit(UnitRegisters.of(event.unit), event.proof)
        elif incomplete:
            self.view.show_error(lambda: event_sentence(incomplete, {}))
        else:
            self.view.show_error(lambda: say("engineer.write_stopped"))
