"""What a listener asks the engine to do, as plain values that travel between processes."""

import getpass
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal


@dataclass(frozen=True)
class RunRequest:
    """One run.

    Attributes
    ----------
    serial : of the unit in the fixture
    station, product : files; None for the default
    stages : in order; None for the product's
    out : folder for log and result
    operator : who asked, None for the user of the computer
    speed, seed : of the virtual bench; None for the station file's
    resume : log of a run that did not reach its end, to be carried on behind its last finished stage, beside it
        and with its stages and schedule; `stages`, `schedule`, `out` and `seed` do not count then
    unfinished : what to do about an interrupted transfer of the unit's registers, "finish" or "restore"; None refuses
        the run and tells the offers
    faults : plan of what goes wrong on the virtual bench (`fault_plan`); None for the station file's
    beyond_attempts : an engineer allows a unit whose attempts are used up
    schedule : parameters of stages' methods in place of the product's, by stage; None for the product's
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


#: Ends what is told of a table that keeps an errand at registers from beginning.
OR_AT_REST = "; or leave the table alone: --at-rest"


@dataclass(frozen=True)
class RegisterOperation:
    """What is to be done to a unit's registers without a run.

    Attributes
    ----------
    request : the unit, where it is, the folder of the runs with the journal, and who asks (`operator`)
    what : write `values`; or finish an interrupted transfer; or restore what the unit held before one
    values : SI by parameter; registers of other parameters keep theirs
    source : where the values come from
    transfer : before which the unit held what is to be restored; None for the latest, interrupted or not
    at_rest : leave the table alone: the output is proved at rest, without a turn
    """

    request: RunRequest
    what: Literal["write", "finish", "restore"]
    values: Mapping[str, float] = field(default_factory=dict)
    source: str = ""
    transfer: str | None = None
    at_rest: bool = False


def computer_user() -> str | None:
    """The user's login name, None where the computer does not tell."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return None
