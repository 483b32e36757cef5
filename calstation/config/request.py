"""Requests to the engine, which can be passed from one process to another."""

import getpass
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from calstation.records import OverriddenSection

#: Control and other characters that XML, and therefore a digital certificate, cannot contain.
_NOT_TEXT = re.compile("[\x00-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]+")


def plain_text(entered: str) -> str:
    """Replace control characters in an entered reason, badge or name by blanks."""
    return _NOT_TEXT.sub(" ", entered).strip()


@dataclass(frozen=True)
class Confirmation:
    """The acting and the confirming person for the audit trail, by name and badge as far as the station knows them."""

    by: str  #: Acting person; "" for the program.
    confirmed_by: str | None = None
    #: Whether personal PINs were checked, or the site's PIN, which does not identify a person; None for no PIN.
    pin: Literal["personal", "site"] | None = None

    @property
    def people(self) -> tuple[str, ...]:
        """Both persons, without those that are not known."""
        return tuple(filter(None, (self.by, self.confirmed_by)))


@dataclass(frozen=True)
class RunRequest:
    """Request for a run."""

    serial: str
    station: Path | None = None  #: Station file; None for the default.
    product: Path | None = None  #: Product file; None for the default.
    stages: tuple[str, ...] | None = None  #: Stages in order; None for the stages of the product.
    out: Path = Path("runs")  #: Folder for the log and the result.
    #: Person who requested the run, by badge if operators sign in at the station; None for the user of the computer.
    operator: str | None = None
    #: Serial numbers of a batch in the order of the station's slots, "" for an empty slot; () for a single unit.
    serials: tuple[str, ...] = ()
    slot: str | None = None  #: Name of the unit's slot; None at a station with one unit.
    batch: str | None = None  #: Common identifier of the runs of a batch.
    batch_units: tuple[str, ...] = ()  #: Serial numbers of all units of the batch, in the order of their slots.
    batch_slots: tuple[str, ...] = ()  #: Names of these slots.
    #: Speed of the virtual bench as a multiple of real time, 0 for maximum speed; None for the station's value.
    speed: float | None = None
    seed: int | None = None  #: Seed of the virtual bench; None for the station file's seed.
    #: Method parameters that replace the product's, by stage.
    schedule: Mapping[str, Mapping[str, Any]] | None = None
    #: Log of an incomplete run that is resumed after its last completed stage, with its stages, schedule, seed and
    #: folder; for a batch, the log of its first unit.
    resume: Path | None = None
    #: Logs of all units of a batch that is resumed, in the order of their slots; () for a single unit.
    resumes: tuple[Path, ...] = ()
    beyond_attempts: bool = False  #: Whether an engineer permits a run although the unit has used all its attempts.
    #: Engineer at the window who permits it; None for the operator.
    allowed_by: Confirmation | None = None
    #: Reason why an engineer permits a run despite a failed or overdue check standard or certificate, or None.
    override_standard: str | None = None
    #: Persons who permit this run (see `calstation.config.confirm`); None for the operator at a site without PINs.
    overridden_by: Confirmation | None = None
    #: Check standards and instruments despite which this run is permitted.
    overridden: tuple[OverriddenSection, ...] = ()
    faults: Path | None = None  #: Fault plan of the virtual bench; None for the station file's plan.
    #: Action after an interrupted transfer of the unit's registers; None refuses the run.
    unfinished: Literal["finish", "restore"] | None = None

    def __post_init__(self) -> None:
        """Remove control characters from entered texts, and replace "-" for an empty slot."""
        object.__setattr__(self, "serials", tuple("" if serial == "-" else serial for serial in self.serials))
        for name in ("operator", "override_standard"):
            entered = getattr(self, name)
            if entered is not None:
                object.__setattr__(self, name, plain_text(entered))


@dataclass(frozen=True)
class RegisterOperation:
    """An operation on a unit's registers outside a run."""

    request: RunRequest  #: Unit, station, runs folder with the journal, and operator.
    #: Whether to write `values`, finish an interrupted transfer, or restore the registers from before a transfer.
    what: Literal["write", "finish", "restore"]
    values: Mapping[str, float] = field(default_factory=dict)  #: Values to write, by parameter, SI; others are kept.
    source: str = ""  #: Origin of the values.
    transfer: str | None = None  #: The transfer to undo; None for the latest.
    at_rest: bool = False  #: Whether to verify the output at rest, without moving the table.
    people: Confirmation | None = None  #: From `calstation.config.confirm`; None for an operator without a PIN.


def computer_user() -> str | None:
    """Return the login name of this computer's user, or None if it is unknown."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return None
