"""Requests to the engine, as plain values that travel between processes."""

import getpass
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal


@dataclass(frozen=True)
class RunRequest:
    """A run.

    Attributes
    ----------
    serial : of the unit in the fixture
    station, product : files; None for the defaults
    stages : in order; None for the product's
    out : folder of log and result
    operator : who requested it; None for the user of the computer
    speed, seed : of the virtual bench; None for the station file's
    schedule : parameters of stages' methods that replace the product's, by stage
    resume : log of an incomplete run to continue after its last completed stage, with the stages, schedule, seed and
        folder of that run
    beyond_attempts : an engineer allows a unit that has used up its attempts
    faults : plan of faults on the virtual bench; None for the station file's
    unfinished : what to do about an interrupted transfer of the unit's registers; None refuses the run
    """

    serial: str
    station: Path | None = None
    product: Path | None = None
    stages: tuple[str, ...] | None = None
    out: Path = Path("runs")
    operator: str | None = None
    speed: float | None = None
    seed: int | None = None
    schedule: Mapping[str, Mapping[str, Any]] | None = None
    resume: Path | None = None
    beyond_attempts: bool = False
    faults: Path | None = None
    unfinished: Literal["finish", "restore"] | None = None


@dataclass(frozen=True)
class RegisterOperation:
    """An operation on a unit's registers without a run.

    Attributes
    ----------
    request : unit, station, folder of the runs with the journal, and operator
    what : write `values`, finish an interrupted transfer, or restore the registers of before a transfer
    values : by parameter, SI; other registers stay as they are
    source : origin of the values
    transfer : the transfer to undo; None for the latest
    at_rest : verify the output at rest, without moving the table
    """

    request: RunRequest
    what: Literal["write", "finish", "restore"]
    values: Mapping[str, float] = field(default_factory=dict)
    source: str = ""
    transfer: str | None = None
    at_rest: bool = False


def computer_user() -> str | None:
    """Login name of this computer's user, or None if it is unknown."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return None
