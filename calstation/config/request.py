"""Requests to the engine, as plain values that travel between processes."""

import getpass
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal


@dataclass(frozen=True)
class RunRequest:
    """A run."""

    serial: str
    station: Path | None = None  #: File; None for the default.
    product: Path | None = None  #: File; None for the default.
    stages: tuple[str, ...] | None = None  #: In order; None for those of the product.
    out: Path = Path("runs")  #: Folder of log and result.
    operator: str | None = None  #: Who requested it; None for the user of the computer.
    speed: float | None = None  #: Of the virtual bench; None for that of the station file.
    seed: int | None = None  #: Of the virtual bench; None for that of the station file.
    #: Parameters of stages' methods that replace the product's, by stage.
    schedule: Mapping[str, Mapping[str, Any]] | None = None
    #: Log of an incomplete run to continue after its last completed stage, with the stages, schedule, seed and folder
    #: of that run.
    resume: Path | None = None
    beyond_attempts: bool = False  #: An engineer allows a unit that has used up its attempts.
    faults: Path | None = None  #: Plan of faults on the virtual bench; None for the station file's.
    #: What to do about an interrupted transfer of the unit's registers; None refuses the run.
    unfinished: Literal["finish", "restore"] | None = None


@dataclass(frozen=True)
class RegisterOperation:
    """An operation on a unit's registers without a run."""

    request: RunRequest  #: Unit, station, folder of the runs with the journal, and operator.
    #: Write `values`, finish an interrupted transfer, or restore the registers of before a transfer.
    what: Literal["write", "finish", "restore"]
    values: Mapping[str, float] = field(default_factory=dict)  #: To write, by parameter, SI; others keep their values.
    source: str = ""  #: Origin of the values.
    transfer: str | None = None  #: The transfer to undo; None for the latest.
    at_rest: bool = False  #: Verify the output at rest, without moving the table.


def computer_user() -> str | None:
    """Login name of this computer's user, or None if it is unknown."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return None
