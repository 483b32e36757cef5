"""`RunRequest`: what a listener asks the engine to run, as plain values that travel between processes."""

from collections.abc import Mapping
from dataclasses import dataclass
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
