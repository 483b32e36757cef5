"""Start of a run: the questions before it, the reasons to refuse it, and the request that the engine executes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from calstation.config import (
    ConfirmationRequired,
    Person,
    RunConfiguration,
    RunRequest,
    confirm,
    confirmation_required,
    library,
    load_station,
    new_batch_id,
    prepare_units,
    unit_requests,
    virtual_serials,
)
from calstation.errors import ConfigurationError
from calstation.messages import Text, Value
from calstation.quality import require_standards
from calstation.records import LogMeta, open_log
from calstation.registers import DECISIONS, journal_folder, open_transfer
from calstation.results import History
from calstation.runs.hooks import station_hooks
from calstation.runs.interrupted import Interrupted, interrupted_units
from calstation.runs.resume import Continuation, resumable_run

#: Role of the person who starts a run.
Role = Literal["operator", "engineer"]

#: Subject of a question: a serial number that differs from a known one only by case, an interrupted transfer of
#: registers, an interrupted run of the unit, attempts that are used up, a unit that has passed, a check standard or
#: certificate that is overdue or failed, or the motion of a real table.
Subject = Literal["spelling", "transfer", "resume", "attempts", "passed", "standard", "table_moves"]

#: Refusals of production that an engineer can override.
_OVERRIDABLE = (
    "quality.not_in_order",
    *(f"quality.standard_{reason}" for reason in ("never", "overdue", "failed", "out", "altered", "certificate")),
)


@dataclass(frozen=True)
class Question:
    """A question that a person answers before a run may start."""

    subject: Subject
    text: Text  #: The question, an entry of the catalogue.
    #: Answers with which the run starts, entries of the catalogue family ``answer``; () if only an engineer may answer.
    answers: tuple[str, ...]
    refusal: ConfigurationError  #: Error raised without an answer; its remedy names the option.


class RunStart:
    """A run before its start, with the questions that must be answered.

    `next_question` returns the next question, `answer` and `override` process the answers, and `request` is the request
    that the engine executes, for one unit or for a batch.
    """

    def __init__(self, request: RunRequest, role: Role) -> None:
        """Check a request made by a person of this role; its serial numbers are in the order of the slots.

        Raises ConfigurationError or InputError if the run is not possible as requested.
        """
        self._role, self._history = role, History.at(request.out, load_station(request.station)[1])
        self._answered: set[Subject] = set()
        self._interrupted: Interrupted | None = None
        self._set_request(_complete_request(request, self._history))
        if request.unfinished is not None:  # the questions were asked before the transfer was interrupted
            self._answered |= {"spelling", "transfer", "resume", "passed"}

    def _set_request(self, request: RunRequest) -> None:
        resumed = tuple(continuation.request for continuation in Continuation.of_all(request))
        adjust = station_hooks(load_station(request.station)[1]).adjust
        self.request, self._setups = request, prepare_units(resumed or unit_requests(request), adjust)
        if resumed:  # the questions were asked before the interruption
            self._answered |= {"spelling", "resume", "passed"}

    def next_question(self) -> Question | None:
        """Return the first open question, or None if the run may start. Raises ConfigurationError."""
        questions: dict[Subject, Callable[[], Question | None]] = {
            "spelling": self._ask_spelling,
            "transfer": self._ask_transfer,
            "resume": self._ask_resume,
            "attempts": self._ask_attempts,
            "passed": self._ask_passed,
            "standard": self._ask_standard,
            "table_moves": self._ask_motion,
        }
        with self._history.one_connection():
            asked = (ask() for subject, ask in questions.items() if subject not in self._answered)
            return next(filter(None, asked), None)

    def answer(self, question: Question, answer: str) -> None:
        """Process the answer to a question; a question about a check standard is answered by `override` instead.

        Raises ConfigurationError or InputError if an interrupted run cannot be resumed.
        """
        if answer == "resume" and self._interrupted is not None:
            runs, request = self._interrupted.runs, replace(self.request, product=None)
            if request.serials:
                units = {run.slot or "": (run.serial, run.log) for run in runs}
                request = _resumed_batch(request, units, runs[0].batch)
            else:
                request = replace(request, resume=runs[0].log, product=product_of(runs[0].log))
            self._set_request(replace(request, product=request.product or self.request.product))
        elif question.subject == "transfer" and answer in DECISIONS:
            self._set_request(replace(self.request, unfinished=answer))
        elif answer == "beyond":
            self.request = replace(self.request, beyond_attempts=True)
        self._answered.add(question.subject)

    @property
    def warnings(self) -> list[Text]:
        """Warnings about the products of the units: limits that none of a product's stages can judge."""
        products = {s.product.name: s.unjudged_limits for s in self._setups}
        return [Text.of("run.unjudged_limits", product=name, names=names) for name, names in products.items() if names]

    @property
    def override_required(self) -> ConfirmationRequired:
        """The persons who must confirm an `override`."""
        return confirmation_required("override", self._strictest.product, self._strictest.station)

    def override(self, reason: str, first: Person | None, second: Person | None = None) -> None:
        """Permit the run despite a check standard or a certificate that is overdue or has failed.

        `first` is None at a site without PINs, where a reason suffices. Raises ConfigurationError if the reason is
        missing, or if a person is not allowed to permit the run.
        """
        if not reason.strip():
            raise ConfigurationError("quality.no_reason")
        setup = self._strictest
        people = None if first is None else confirm("override", setup.product, setup.station, first, second)
        self.request = replace(self.request, override_standard=reason, overridden_by=people)
        self._answered.add("standard")

    @property
    def _strictest(self) -> RunConfiguration:
        """Configuration of a unit whose product requires two people for an override, or else of the first unit."""
        setups = (s for s in self._setups if confirmation_required("override", s.product, s.station).second)
        return next(setups, self._setups[0])

    def _ask_spelling(self) -> Question | None:
        """Ask about the units without a run whose serial numbers differ from known ones only by case."""
        known = {setup.request.serial: self._history.other_spellings(setup.request.serial) for setup in self._setups}
        serials = [serial for serial, others in known.items() if others]
        if not serials:
            return None
        values: dict[str, Value] = {
            "serials": serials,
            "known": [other for serial in serials for other in known[serial]],
        }
        refusal = ConfigurationError("run.other_spelling", **values)
        return Question("spelling", Text("question.other_spelling", values), ("other_unit",), refusal)

    def _ask_transfer(self) -> Question | None:
        """Ask about the units whose registers may have been changed by a transfer that was not verified."""
        folder = journal_folder(self._setups[0].station, self.request.out)
        serials = (setup.request.serial for setup in self._setups)
        transfers = [transfer for serial in serials if (transfer := open_transfer(folder, serial)) is not None]
        if not transfers:
            return None
        units = [transfer.serial for transfer in transfers]
        code = "transfer_unverified" if all(transfer.written for transfer in transfers) else "transfer_interrupted"
        refusal = ConfigurationError(f"run.{code}", serials=units)
        which = "units_" if len(units) > 1 else ""
        by_hand = "_manual" if self._setups[0].table.by_hand else ""
        text = Text(f"question.{which}{code}{by_hand}", {"serial": units[0], "serials": units})
        return Question("transfer", text, DECISIONS[::-1], refusal)

    def _ask_resume(self) -> Question | None:
        request, station = self.request, self._setups[0].station
        if request.serials:
            slots = {serial: slot for slot, serial in zip(station.slot_names, request.serials, strict=False) if serial}
            self._interrupted = interrupted_units(self._history, slots, station.name)
        else:
            run = resumable_run(self._history, request.serial, station.name)
            self._interrupted = None if run is None else Interrupted((run,))
        if self._interrupted is None:
            return None
        question = self._interrupted.question([setup.product.name for setup in self._setups])
        logs = self._interrupted.logs
        if not logs:
            return Question("resume", question, ("anew",), ConfigurationError("run.in_other_slots", **question.values))
        code = "run.units_interrupted_before" if request.serials else "run.interrupted_before"
        options = " ".join(f"--resume {log}" for log in logs)
        refusal = ConfigurationError(code, options=options, **question.values)
        return Question("resume", question, ("resume", "anew"), refusal)

    def _ask_attempts(self) -> Question | None:
        used_up = self._attempts_used()
        if not used_up or self.request.beyond_attempts:
            return None
        serials = [refusal.values["serial"] for refusal in used_up]
        product, count = used_up[0].values["product"], max(refusal.values["failures"] for refusal in used_up)
        values = {"serial": serials[0], "serials": serials, "product": product, "count": count}
        engineer = self._role == "engineer"
        text = self._text("allow_attempt" if engineer else "set_aside", values)
        return Question("attempts", text, ("beyond",) if engineer else (), used_up[0])

    def _attempts_used(self) -> list[ConfigurationError]:
        """Return the refusals of the units whose attempts are used up."""
        return [refusal for s in self._setups if (refusal := attempts_used(s, self._history)) is not None]

    def _ask_passed(self) -> Question | None:
        used_up = self._attempts_used() if self.request.beyond_attempts else []  # otherwise, `_ask_attempts` found none
        failed = {refusal.values["serial"] for refusal in used_up}
        units = [s.request.serial for s in self._setups if s.check_standard is None]
        passed = [run for serial in units if serial not in failed and (run := self._history.passed_before(serial))]
        if not passed:
            return None
        first, serials = passed[0], [run.serial for run in passed]
        products = list(dict.fromkeys(run.product or "?" for run in passed))
        values = {
            "serial": first.serial,
            "when": first.started_utc,
            "station": first.station or "?",
            "serials": serials,
            "product": products[0],
            "products": products,
        }
        code = "passed_elsewhere" if first.origin and not self.request.serials else "passed_before"
        refusal = ConfigurationError("run.passed_before", serials=serials, products=products)
        return Question("passed", self._text(code, values), ("repeat",), refusal)

    def _ask_standard(self) -> Question | None:
        for setup in self._setups:
            try:
                require_standards(setup, self._history, datetime.now(UTC))
            except ConfigurationError as error:
                if error.code not in _OVERRIDABLE:
                    raise
                return Question("standard", error.as_text, ("override",), error)
        return None

    def _ask_motion(self) -> Question | None:
        setup = self._setups[0]
        if setup.station.bench is not None or setup.table.by_hand:
            return None
        station = setup.station.name
        refusal = ConfigurationError("run.table_moves", station=station)
        return Question("table_moves", Text.of("question.table_moves", station=station), ("clear",), refusal)

    def _text(self, name: str, values: dict[str, Value]) -> Text:
        """Return a question about the only unit or about units of a batch."""
        return Text(f"question.{'units_' if self.request.serials else ''}{name}", values)


def attempts_used(setup: RunConfiguration, history: History) -> ConfigurationError | None:
    """Return the error if the attempts of a unit are used up, otherwise None; check standards have no limit."""
    serial, product, allowed = setup.request.serial, setup.product, setup.product.attempts_allowed
    if allowed is None or setup.check_standard is not None:
        return None
    failures = history.failures(serial, product.name)
    if failures < allowed:
        return None
    return ConfigurationError(
        "run.attempts_used", serial=serial, failures=failures, allowed=allowed, product=product.name
    )


def _complete_request(request: RunRequest, history: History) -> RunRequest:
    """Complete a request with the unit of the log to resume, the units of the bench, and the id of a batch.

    Raises ConfigurationError if it names no unit, or InputError if the log cannot be read.
    """
    path, station = load_station(request.station)
    if request.resumes or request.resume is not None:
        return _complete_resumed(request)
    serials = request.serials or (request.serial,)
    if not any(serials) and request.serials:
        raise ConfigurationError("batch.no_unit", station=path)
    if not any(serials) and station.bench is None:
        raise ConfigurationError("run.serial_missing", path=path)
    if not any(serials):
        # the same seed selects the same unit, even if it has passed
        serials = virtual_serials(
            station.bench or {},
            station.slot_names,
            lambda s: request.seed is None and history.passed_before(s) is not None,
        )
    if not station.slot_names and len(serials) == 1:
        return replace(request, serial=serials[0], serials=())
    return replace(request, serial=next(filter(None, serials)), serials=serials, batch=new_batch_id())


def _complete_resumed(request: RunRequest) -> RunRequest:
    """Complete a request that resumes runs with the product, the units and the slots of their logs.

    Raises ConfigurationError if the product is unknown, two logs are of the same slot, or the request names other units
    than the logs, and InputError if a log cannot be read.
    """
    logs = request.resumes or ((request.resume,) if request.resume is not None else ())
    metas = [open_log(log).meta for log in logs]
    given = set(filter(None, request.serials))
    if len(given) > (0 if request.resumes else 1) and given != {meta.imu.serial for meta in metas}:
        raise ConfigurationError("batch.resume")
    if request.resumes:
        batch = None if metas[0].run is None else metas[0].run.batch
        request = _resumed_batch(request, _by_slot(request, metas), batch)
    else:
        serial = next(filter(None, (request.serial, *request.serials)), metas[0].imu.serial)
        slot = None if metas[0].run is None else metas[0].run.slot
        product = request.product or product_of(logs[0])
        request = replace(request, serial=serial, serials=(), product=product, slot=slot)
    name = _product_name(metas[0])
    if request.product is None and name is not None:
        raise ConfigurationError("run.resume_product", path=logs[0], name=name)
    return request


def _by_slot(request: RunRequest, metas: Sequence[LogMeta]) -> dict[str, tuple[str, Path]]:
    """Return the serial number and the log of each unit of a batch by slot. Raises ConfigurationError."""
    units: dict[str, tuple[str, Path]] = {}
    station = load_station(request.station)[1]
    for log, meta in zip(request.resumes, metas, strict=True):
        slot = None if meta.run is None else meta.run.slot
        if slot not in station.slot_names:
            raise ConfigurationError("run.no_slot", path=log, slot=slot or "–", station=station.name)
        if slot in units:
            raise ConfigurationError("run.same_slot", path=log, other=units[slot][1], slot=slot)
        units[slot] = meta.imu.serial, log
    return units


def _resumed_batch(request: RunRequest, units: Mapping[str, tuple[str, Path]], batch: str | None) -> RunRequest:
    """Return the request that resumes a batch; its product applies to the slots without a product of their own.

    Parameters
    ----------
    request : request with the station, and with the product if it is known
    units : serial number and log of each unit by slot
    batch : identifier of the batch
    """
    station = load_station(request.station)[1]
    occupied = [(name, *units[name]) for name in station.slot_names if name in units]
    own = {slot.name for slot in station.slots if slot.product is not None}
    shared = next((log for name, _, log in occupied if name not in own), occupied[0][2])
    return replace(
        request,
        serial=occupied[0][1],
        serials=tuple(units[name][0] if name in units else "" for name in station.slot_names),
        product=request.product or product_of(shared),
        resume=occupied[0][2],
        resumes=tuple(log for _, _, log in occupied),
        batch=batch,
    )


def product_of(log: Path) -> Path | None:
    """Return the product file of the run of a log, or None if the log names none or the library does not contain it.

    Raises InputError if the log cannot be read.
    """
    name = _product_name(open_log(log).meta)
    return library.find("products", name) if name in library.names("products") else None


def _product_name(meta: LogMeta) -> str | None:
    """Return the name of the product file of a run, or None if its log does not name it."""
    return meta.run.files["product"].name if meta.run is not None and meta.run.files else None
