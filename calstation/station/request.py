"""`RunRequest`: what a listener asks the engine to run, as plain values that travel between processes."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class RunRequest:
    """One run.

    Attributes
    ----------
    serial : of the unit in the fixture
    station, product : files; None for the default
    stages : in order; None for the product's
    out : folder for log and result
    operator : who asked, None where not said
    speed, seed : of the virtual bench; None for the station file's
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
