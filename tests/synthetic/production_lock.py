"""Demonstration of when a station with a golden unit refuses production, with the same functions as a run."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomli_w

from calstation.bench import BenchConfig
from calstation.config import DEFAULT_STATION, RunRequest, library, load_configuration
from calstation.errors import ConfigurationError
from calstation.physics import NAMES
from calstation.records import audit_path, read_audit
from calstation.results import Result
from calstation.runs import execute, prepare
from calstation.schema import read_toml
from calstation.sequencer import Control, Event, Finalized
from calstation.simulation import bench_config

GOLDEN, UNIT = "SN-000001", "SN-000042"
PRODUCT = "nav_a_fast"
#: Days between golden runs, and the interval that makes the last one overdue, 1 s.
INTERVAL, OVER = 7.0, 1.0 / 86400.0
#: Relative error of the entered gravity, a typical error of gravity that was not surveyed.
GRAVITY_ERROR = 5e-5
#: Standard deviation of the reference, relative to the limit of a parameter's sigma in the product.
_REFERENCE = 0.2
REASON = "golden unit at the laboratory until Friday"


@dataclass(frozen=True)
class LockStep:
    """Result of a step of the demonstration; `code` is the catalogue code of its sentence, without the family."""

    code: str
    values: Mapping[str, Any]
    passed: bool  #: Whether the step matches its expectation.


def lock_demo(folder: Path, seed: int) -> Iterator[LockStep]:
    """Yield the steps as they happen; `folder`, an empty one, receives the files of the site and of the runs."""
    with _home(folder / "home"):
        site = _Site(folder, seed)
        yield site.refused("first", "quality.standard_never")
        yield site.golden("agrees", passes=True)
        yield site.allowed("after")
        yield site.refused("overdue", "quality.standard_overdue", interval=OVER)
        yield site.golden("disagrees", passes=False, error=GRAVITY_ERROR)
        yield site.refused("out", "quality.standard_out", error=GRAVITY_ERROR)
        yield site.overridden()
        yield site.golden("corrected", passes=True)
        yield site.allowed("again")


@contextmanager
def _home(folder: Path) -> Iterator[None]:
    """Use a separate folder for the site, so that its audit trail and its files are not changed."""
    before = os.environ.get("CALSTATION_HOME")
    os.environ["CALSTATION_HOME"] = str(folder)
    try:
        yield
    finally:
        os.environ.pop("CALSTATION_HOME")
        if before is not None:
            os.environ["CALSTATION_HOME"] = before


class _Site:
    """Station and product with a check standard, whose reference is the bench's truth with an uncertainty."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._station = read_toml(library.shipped_folder() / "stations" / f"{DEFAULT_STATION}.toml")
        self._gravity = float(self._station["site"]["gravity_mps2"])
        self._station["bench"] |= {"seed": seed, "gravity_mps2": self._gravity}
        self._product = read_toml(library.shipped_folder() / "products" / f"{PRODUCT}.toml")
        station, product = folder / "station.toml", folder / "product.toml"
        self._request = RunRequest(UNIT, station, product, out=folder / "runs", operator="demo")
        self._reference: dict[str, Any] = {}
        self._write()
        resolved = load_configuration(replace(self._request, serial=GOLDEN))
        true = BenchConfig.model_validate(bench_config(resolved)).truth().parameters
        for name, value in zip(NAMES, true.tolist(), strict=True):
            limit = resolved.product.limits[name.rsplit("_", 1)[0]]
            self._reference[name] = {"value": value, "sigma": _REFERENCE * (limit.sigma_below or 0.0)}

    def refused(self, code: str, expected: str, error: float = 0.0, interval: float = INTERVAL) -> LockStep:
        """Request a production run that should be refused with an error."""
        self._write(error, interval)
        found = self._production()
        reason = "" if found is None else found.render().text
        return LockStep(f"lock_{code}", {"reason": reason}, found is not None and found.code == expected)

    def allowed(self, code: str) -> LockStep:
        """Request a production run that should be allowed."""
        return LockStep(f"lock_{code}", {}, self._production() is None)

    def overridden(self) -> LockStep:
        """Request a production run that is refused and that an engineer permits."""
        allowed = self._production() is not None and self._production(REASON) is None
        event = read_audit(audit_path(library.site_folder())).entries[-1]
        recorded = (event.event, event.why) == ("standard_overridden", REASON)
        values = {"reason": REASON, "by": event.by, "event": event.event}
        return LockStep("lock_overridden", values, allowed and recorded)

    def golden(self, code: str, *, passes: bool, error: float = 0.0) -> LockStep:
        """Calibrate the golden unit through the bench's protocols."""
        self._write(error)
        events: list[Event] = []
        execute(replace(self._request, serial=GOLDEN), events.append, Control())
        (run,) = (event for event in events if isinstance(event, Finalized))
        compared = Result.from_json(run.result).check_standard
        assert compared is not None
        worst = max(compared.e_n, key=lambda name: abs(compared.e_n[name]))
        values = {
            "outcome": run.verdict.outcome,
            "parameter": worst,
            "e_n": abs(compared.e_n[worst]),
            "e_n_limit": compared.e_n_limit,
            "t_squared": compared.t_squared,
            "t_squared_limit": compared.t_squared_limit,
            "ppm": 1e6 * GRAVITY_ERROR,
        }
        return LockStep(f"lock_{code}", values, compared.passed == run.verdict.passed == passes)

    def _production(self, override: str | None = None) -> ConfigurationError | None:
        """Prepare a production run like `calstation run`; return the error that refuses it."""
        try:
            prepare(replace(self._request, override_standard=override), lambda _: None, Control())
        except ConfigurationError as error:
            return error
        return None

    def _write(self, error: float = 0.0, interval: float = INTERVAL) -> None:
        """Write both files, with a relative error of gravity in the station file."""
        site = {**self._station["site"], "gravity_mps2": self._gravity * (1.0 + error)}
        standard = {"serial": GOLDEN, "interval_days": interval, "reference": self._reference}
        standards = {"check_standards": [standard]} if self._reference else {}
        for path, content in (
            (self._request.station, {**self._station, "site": site}),
            (self._request.product, {**self._product, **standards}),
        ):
            assert path is not None
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(tomli_w.dumps(content), encoding="utf-8")
