"""The registers view at work: what a result wants, what the unit holds, and the write that was asked for."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from calstation.config.request import RegisterOperation, RunRequest
from calstation.gui.engineer.registers_view import RegistersView
from calstation.gui.shell.context import AppContext
from calstation.gui.text.messages import event_sentence, fault_text, step_sentence
from calstation.gui.widgets.jobs import JobWatch
from calstation.registers.unit_registers import TargetRegisters, UnitRegisters, read_unit, wanted_registers
from calstation.results.finished_run import FinishedRun
from calstation.sequencer.events import Event, Fault, Message, Settled, StepStarted

#: Stands for the unit in a request where none is named yet.
UNNAMED = "-"

#: Messages that say how a unit was left whose write did not come to its end.
_LEFT = ("transfer_unproved", "old_unproved")


class RegisterController(QObject):
    """Does the view's work, reading in the workshop, writing by the engine; `changed` when something else may be done.

    request : what would be run now, for its station, product and engineer's name
    """

    changed = Signal()

    def __init__(self, app: AppContext, request: Callable[[], RunRequest], parent: QObject) -> None:
        super().__init__(parent)
        self._app, self._request = app, request
        self._run: FinishedRun | None = None
        self._errand: RegisterOperation | None = None
        self._left = ""
        self.view = RegistersView()
        self._wanting = JobWatch(self)
        self._wanting.done.connect(self._show_wanted)
        self._wanting.failed.connect(self.view.complain)
        self.view.read_wanted.connect(self._read)
        self.view.write_wanted.connect(self._write)
        self.view.watch.done.connect(self._show_unit)
        self.view.watch.failed.connect(lambda _: self.changed.emit())
        app.engine_link.event.connect(self._hear)
        app.product_changed.connect(self._take_again)

    def take(self, run: FinishedRun) -> None:
        """Another run is looked at: find what it wants in the registers."""
        self._run = run
        self.view.show_wanted(None)
        if run.result_json["parameters"]:
            job = self._app.job_queue.submit(wanted_registers, self._request(), run.result)
            self._wanting.watch(job)

    def _take_again(self) -> None:
        """What was wanted was of the product before; the unit is another one's as well."""
        if self._run is not None and self._errand is None:
            self.take(self._run)

    def why_not(self) -> str:
        """Why nothing can be written yet, "" where it can."""
        view = self.view
        if view.wanted is None:
            return self.tr("Open a result or finish a run first: its values are what is written.")
        if view.unit is None:
            return self.tr("Read the unit first, so that what changes can be seen.")
        named = self._request().serial
        for serial in (view.unit.serial, view.unit.serial if named == UNNAMED else named):
            if serial != view.wanted.serial:
                return self.tr("Unit {0} is in the fixture, the result is of {1}.").format(
                    serial, view.wanted.serial
                )
        return "" if view.changes else self.tr("The unit holds these values already.")

    def _show_wanted(self, wanted: TargetRegisters) -> None:
        self.view.show_wanted(wanted)
        self.changed.emit()

    def _read(self) -> None:
        job = self._app.job_queue.submit(read_unit, self._request(), self._app.runs_folder, cancellable=False)
        self.view.watch.watch(job)
        self.view.begin()
        self.changed.emit()

    def _show_unit(self, unit: UnitRegisters) -> None:
        self.view.show_unit(unit)
        self.changed.emit()

    def _write(self, values: Mapping[str, float], at_rest: bool) -> None:
        assert self._run is not None
        if self._app.job_queue.at_device:
            self.view.regret(
                lambda: self.tr("Another page is talking to a device; try again in some seconds.")
            )
            return
        result = self._run.result_json
        self._errand = RegisterOperation(
            replace(self._request(), serial=str(result["unit"]["serial"])),
            "write",
            dict(values),
            Path(result["log"]["file"]).name,
            at_rest=at_rest,
        )
        self._left = ""
        self.view.begin()
        self.view.tell(lambda: self.tr("Starting the engine and connecting."))
        self._app.engine_link.start(self._errand)

    def _hear(self, event: Event) -> None:
        """How the write in hand gets on, and how it ended."""
        if self._errand is None or self._app.engine_link.operation is not self._errand:
            return
        if isinstance(event, Message):
            key, values = event.id, event.values
            if key in _LEFT:
                self._left = key
            self.view.tell(lambda: event_sentence(key, values))
        elif isinstance(event, StepStarted):
            kind, label = event.kind, event.label
            self.view.tell(lambda: step_sentence(kind, label))
        elif isinstance(event, Settled):
            self._errand = None
            if event.closing == "stopped":
                left = self._left
                self.view.regret(lambda: self._word_stopped(left))
            else:
                self.view.show_unit(UnitRegisters.of(event.unit), event.proof)
            self.changed.emit()
        elif isinstance(event, Fault):
            self._errand = None
            self.view.regret(lambda: fault_text(event).sentences)
            self.changed.emit()

    def _word_stopped(self, left: str) -> str:
        """How a stop has left the unit."""
        return event_sentence(left, {}) if left else self.tr("Stopped before anything was written.")
