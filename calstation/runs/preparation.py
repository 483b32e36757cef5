"""Preparation of a requested run: its configuration, folder, history and log."""

import logging
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any

from calstation.config import (
    Confirmation,
    RunConfiguration,
    RunRequest,
    can_confirm_identity,
    confirmation_required,
    load_station,
    new_batch_id,
    prepare_units,
    site_folder,
    unit_requests,
)
from calstation.errors import ConfigurationError
from calstation.escaping import for_file_name
from calstation.judgement import is_partial
from calstation.messages import Text, os_reason
from calstation.physics import INDEX, group_indices
from calstation.quality import require_standards
from calstation.records import RESERVED_SPACE, LogMeta, RawLogWriter, append_audit, free_space, intact_trail, locked
from calstation.registers import UnverifiedTransfer, check_flash, check_interrupted
from calstation.results import History, StageChain, current_calibration, register_pending
from calstation.runs.cycle import Cycle
from calstation.runs.hooks import RunHooks, station_hooks
from calstation.runs.incomplete import attempts_in_progress, finish_incomplete
from calstation.runs.resume import Continuation
from calstation.runs.start import attempts_used
from calstation.sequencer import Control, Emit, Event, Message, times, to_json

#: Longest time to wait for another program that creates a log, s.
_LOCK_TIMEOUT = 10.0

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class PreparedRun:
    """The run of a unit before its devices are opened; `continuation` is the earlier part of a resumed run.

    The units of a batch share a `cycle`, which follows the events passed to the `listener`.
    """

    setup: RunConfiguration
    history: History
    listener: Emit
    control: Control
    hooks: RunHooks
    continuation: Continuation | None
    started: datetime
    cycle: Cycle

    def emit(self, event: Event) -> None:
        """Pass an event that concerns this unit to the listener."""
        self.listener(replace(event, slot=self.slot))

    @property
    def slot(self) -> str:
        """Name of the slot of the unit; "" at a station with one unit."""
        return self.setup.request.slot or ""

    @property
    def folder(self) -> Path:
        """Folder of the log."""
        return self.setup.request.out

    def meta(self, registers: dict[str, float] | None) -> tuple[LogMeta, Message | None]:
        """Return the configuration of the log, and a message about the prior of a partial run that is not resumed.

        `registers` are the registers of the unit, SI, or None if they could not be read. The prior of a partial run is
        the current calibration. Raises ConfigurationError or DeviceFaultError if the conditions of a run to be resumed
        have changed.
        """
        continuation, serial, message = self.continuation, self.setup.request.serial, None
        attempt = 1 + self._attempts() if continuation is None else continuation.attempt
        meta = self.setup.log_meta(self.started, attempt, registers)
        if registers is not None and is_partial(meta) and meta.temperature is None:
            calibration, message = current_calibration(self.history, self.setup, registers)
            if calibration is not None:
                meta = calibration.prior(self.setup, meta)
        if continuation is not None:
            return continuation.meta(meta, registers is not None), None
        checks = self.setup.product.checks
        if checks is None or checks.previous is None:
            return meta, message
        mounting = group_indices("outer_lever") if self.slot else ()  # another slot has a different lever arm
        previous, _ = self.history.previous(serial, self.setup.product.name)
        values = {name: each.value for name, each in previous.items() if name in INDEX and INDEX[name] not in mounting}
        return meta.model_copy(update={"previous": values}), message

    def _attempts(self) -> int:
        """Return the number of runs of the unit in the folder, including those that other programs are executing."""
        serial = self.setup.request.serial
        return max([self.history.attempts(serial), *attempts_in_progress(self.folder, self._file_name, serial)])

    @property
    def _file_name(self) -> str:
        """Beginning of the name of the log."""
        return for_file_name(self.setup.request.serial)

    def open(self, registers: dict[str, float] | None, unverified: UnverifiedTransfer | None = None) -> "OpenRun":
        """Create the log of the run, and register its result as pending for the hand-over.

        Raises the errors of `meta`, and ConfigurationError if the log cannot be created.
        """
        with _attempts_locked(self.folder):
            self.history.refresh()
            return self._open(registers, unverified)

    def _open(self, registers: dict[str, float] | None, unverified: UnverifiedTransfer | None) -> "OpenRun":
        meta, message = self.meta(registers)
        stem = self._file_name
        if self.setup.request.batch:  # the names of the logs of a batch must differ
            stem = f"{stem}_{self.slot}"
        log = RawLogWriter(
            self.folder / f"{stem}_{self.started:%Y%m%dT%H%M%S%f}.h5",
            meta,
            joints=self.setup.table.gimbal is not None,
            station=True,
            chamber=meta.temperature is not None,
        )
        with suppress(OSError):  # a full disk is reported when the result is written
            register_pending(self.folder, log.path.stem)
        self.hooks.log_opened(log)
        run = OpenRun(self, meta, log, StageChain(meta), unverified)
        if registers:
            run.set_registers(registers)
        if message is not None:
            run.emit(message)
        if changed := self.setup.changed_schedules:
            run.emit(Message("schedule_changed", {"stages": changed}))
        return run


@contextmanager
def _attempts_locked(folder: Path) -> Iterator[None]:
    """Let one program at a time count the runs in a folder and create the next log, if the folder supports locks."""
    with ExitStack() as stack:
        with suppress(OSError):
            stack.enter_context(locked(folder / ".attempts.lock", _LOCK_TIMEOUT))
        yield


@dataclass
class OpenRun:
    """A run with its log; `registers` is the registers section of the result, {} if no register was read."""

    prepared: PreparedRun
    meta: LogMeta
    log: RawLogWriter
    chain: StageChain
    unverified: UnverifiedTransfer | None = None
    registers: dict[str, Any] = field(default_factory=dict)
    closed: bool = False  #: Whether its result has been written.
    #: Command that makes the report of its result; empty if there is none.
    report: list[str] = field(default_factory=list)

    @property
    def setup(self) -> RunConfiguration:
        """Configuration of the run."""
        return self.prepared.setup

    @property
    def serial(self) -> str:
        """Serial number of the unit."""
        return self.meta.imu.serial

    def set_registers(self, old: Mapping[str, float]) -> None:
        """Record the registers read from the unit, by parameter, SI, before any is written."""
        self.registers |= {"old": dict(old), "new": None, "verified": False}

    def emit(self, event: Event) -> None:
        """Pass an event to the log and the listener."""
        self.record(to_json(event))
        self.prepared.emit(event)

    def record(self, event: Mapping[str, Any]) -> None:
        """Write an event, given as JSON data, into the log with the current time."""
        self.log.event({**event, **times(self.prepared.cycle.station_time())})


def prepare(
    request: RunRequest, emit: Emit, control: Control, hooks: type[RunHooks] | None = None
) -> tuple[PreparedRun, ...]:
    """Perform all checks that need no open device, and return the run of each unit.

    Raises ConfigurationError or InputError if the run is not possible as requested.

    Parameters
    ----------
    request : run of a unit or of a batch
    emit : called with every event
    control : commands to the run
    hooks : replaces the hooks of the station
    """
    cycle, continuations = Cycle(), Continuation.of_all(request)
    if continuations:
        request = continuations[0].request
    elif request.serials and request.batch is None:
        request = replace(request, batch=new_batch_id())
    run_hooks = station_hooks(load_station(request.station)[1]) if hooks is None else hooks()
    requests = tuple(continuation.request for continuation in continuations) or unit_requests(request)
    setups = prepare_units(requests, run_hooks.adjust)
    _check_folder(request.out)
    for log in finish_incomplete(request.out):
        emit(Message("incomplete_run", {"log": str(log)}))
    history, started = History.at(request.out, setups[0].station), datetime.now(UTC)
    history.refresh()
    if any(setup.imu.registers for setup in setups):
        intact_trail(site_folder(), request.out)  # nothing is written to a unit if the audit trail was changed
    permitted = [_check_permitted(setup, history) for setup in setups]
    for setup in permitted:
        check_flash(setup, request.out, partial(_emit_of_slot, emit, setup.request.slot or ""))
        check_interrupted(setup, request.out)
    hook_listener = run_hooks.listener(permitted[0], request.out, emit)

    def listener(event: Event) -> None:
        cycle.follow(event)
        hook_listener(event)

    units = tuple(
        PreparedRun(setup, history, listener, control, run_hooks, continuation, started, cycle)
        for setup, continuation in zip_longest(permitted, continuations)
    )
    for unit in units:
        meta, _ = unit.meta(None)  # raises if a run cannot be resumed unchanged
        files = (meta.run.files if meta.run else None) or {}
        logger.info("run of %s, stages %s", unit.setup.request.serial, ", ".join(unit.setup.stages))
        for kind, section in files.items():
            logger.info("%s %s version %s sha256 %s", kind, section.name, section.version, section.sha256)
    return units


def _emit_of_slot(emit: Emit, slot: str, event: Event) -> None:
    emit(replace(event, slot=slot))


def _check_permitted(setup: RunConfiguration, history: History) -> RunConfiguration:
    """Return the configuration from `_check_standards`. Raises ConfigurationError if a unit must not be calibrated."""
    refusal, request = attempts_used(setup, history), setup.request
    if refusal is not None and not request.beyond_attempts:
        raise refusal
    setup = _check_standards(setup, history)
    if refusal is not None:
        people = request.allowed_by or Confirmation(setup.station.person(request.operator or ""))
        values = {"station": setup.station.name, "pin": people.pin, **refusal.values}
        append_audit(site_folder(), "attempt_allowed", people.by, **values)
    return setup


def _check_standards(setup: RunConfiguration, history: History) -> RunConfiguration:
    """Refuse production if a check standard or a certificate is overdue or failed, unless an override permits it.

    Returns the configuration, with the override only if it was needed. Raises ConfigurationError, also if the site has
    PINs and the person was not identified by one, or if the product requires a second person who has not confirmed.
    """
    problems, request = require_standards(setup, history, datetime.now(UTC)), setup.request
    if not problems:
        return replace(setup, request=replace(request, override_standard=None, overridden_by=None))
    confirmation = request.overridden_by or Confirmation(setup.station.person(request.operator or ""))
    if request.overridden_by is None and can_confirm_identity(setup.station):
        raise ConfigurationError("confirmation.standard_required", station=setup.station.name)
    if confirmation_required("override", setup.product, setup.station).second and confirmation.confirmed_by is None:
        raise ConfigurationError("confirmation.second_missing", product=setup.product.name)
    values = {"serial": request.serial, "station": setup.station.name, "product": setup.product.name}
    overridden = [f"{due.reason} {due.name}" for due in problems]
    append_audit(
        site_folder(),
        "standard_overridden",
        confirmation.by,
        request.override_standard or "",
        confirmed_by=confirmation.confirmed_by,
        pin=confirmation.pin,
        overridden=overridden,
        **values,
    )
    sections = tuple(due.section for due in problems)
    return replace(setup, request=replace(request, overridden_by=confirmation, overridden=sections))


def _check_folder(folder: Path) -> None:
    """Raise ConfigurationError if no log can be written to the folder."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".calstation"
        probe.touch()
        probe.unlink()
        free = free_space(probe)
    except OSError as exc:
        raise ConfigurationError("run.folder_unwritable", folder=folder, cause=os_reason(exc)) from exc
    if free < RESERVED_SPACE:
        cause = Text.of("run.disk_low", megabytes=RESERVED_SPACE // 1_000_000)
        raise ConfigurationError("run.folder_unwritable", folder=folder, cause=cause)
