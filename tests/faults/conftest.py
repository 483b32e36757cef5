"""Short runs on the virtual bench with a fault plan, and the expected end of a run after a fault."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.config import RunRequest
from calstation.messages import entry
from calstation.records import open_log
from calstation.runs import execute
from calstation.sequencer import Control, Event, Fault, Finalized, Message, StateChanged, StepStarted
from tests.site_folder import PRODUCT, STATION

SERIAL = "SN-000042"


@dataclass
class Ran:
    """A finished run with its events, files and the final report of the bench."""

    folder: Path
    events: list[Event] = field(default_factory=list)

    @property
    def ended(self) -> Finalized:
        """Return the end of the run."""
        ended = self.events[-1]
        assert isinstance(ended, Finalized)
        return ended

    @property
    def bench(self) -> dict[str, Any]:
        """Return the final state of the bench."""
        report: dict[str, Any] = json.loads((self.folder / "bench.json").read_text(encoding="utf-8"))
        return report

    @property
    def repeated(self) -> list[str]:
        """Return the reasons for repeated steps."""
        return [e.values["reason"] for e in self.events if isinstance(e, Message) and e.id == "step_repeated"]

    @property
    def fault(self) -> Fault:
        """Return the only fault."""
        (fault,) = [e for e in self.events if isinstance(e, Fault)]
        return fault

    def moves_after_fault(self) -> int:
        """Return the number of motions started after the fault."""
        states = [i for i, e in enumerate(self.events) if isinstance(e, StateChanged) and e.state == "fault"]
        return sum(isinstance(e, StepStarted) for e in self.events[states[0] :]) if states else 0

    def assert_stopped(self, *words: str) -> None:
        """Assert that the fault has cause and remedy, the table is at rest with axes off, and all files are kept."""
        ended, text = self.ended, self.fault.text
        assert ended.verdict == "fault"
        assert ended.result["passed"] is False
        for word in words:
            assert word.lower() in text.lower()
        assert ";" in text or entry(self.fault.code).remedy, "a message names what to do"
        assert ended.result["error"] == text
        assert not self.bench["enabled"]
        assert not self.bench["moving"]
        assert self.moves_after_fault() == 0
        log = open_log(Path(ended.log))
        assert log.outcome == "fault"
        assert log.facts().sha256 == ended.result["log"]["sha256"]
        assert any(event.get("event") == "Fault" for event in log.events)


class FaultRuns:
    """A folder with a station, a short product and a fault plan for runs."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.product: dict[str, Any] = PRODUCT
        self.site: dict[str, Any] = {}
        self.table = STATION["table"]["profile"]
        self.chamber: dict[str, Any] = {}  #: `[chamber]` of the station, if it has one.

    def request(self, *faults: dict[str, Any], stages: tuple[str, ...] = ("rate",), **bench: Any) -> RunRequest:
        """Request a run with these faults."""
        self.folder.mkdir(parents=True, exist_ok=True)
        settings = {
            "seed": 5,
            "start_deg": [1.0, -1.0],
            "report_file": str(self.folder / "bench.json"),
            "flash_file": str(self.folder / "flash.bin"),
            **bench,
        }
        for name, content in (
            (
                "station",
                {
                    **STATION,
                    "site": {**STATION["site"], **self.site},
                    "table": {"profile": self.table},
                    "bench": settings,
                    **({"chamber": self.chamber} if self.chamber else {}),
                },
            ),
            ("product", self.product),
            ("plan", {"fault": list(faults)}),
        ):
            (self.folder / f"{name}.toml").write_text(tomli_w.dumps(content), encoding="utf-8")
        return RunRequest(
            SERIAL,
            self.folder / "station.toml",
            self.folder / "product.toml",
            stages,
            self.folder / "runs",
            "tester",
            faults=self.folder / "plan.toml",
        )

    def run(
        self,
        *faults: dict[str, Any],
        stages: tuple[str, ...] = ("rate",),
        on_event: Callable[[Event], None] = lambda event: None,
        unfinished: Any = None,
        control: Control | None = None,
        **bench: Any,
    ) -> Ran:
        """Run in this process."""
        ran = Ran(self.folder)

        def emit(event: Event) -> None:
            ran.events.append(event)
            on_event(event)

        request = replace(self.request(*faults, stages=stages, **bench), unfinished=unfinished)
        execute(request, emit, control or Control())
        return ran


@pytest.fixture
def fault_runs(tmp_path: Path) -> FaultRuns:
    """Empty folder for runs with faults."""
    return FaultRuns(tmp_path)


def fault(kind: str, value: float | None = None, step: int = 1, time_s: float = 0.2) -> dict[str, Any]:
    """Return the plan of a fault in a step of the stage `rate`."""
    entry: dict[str, Any] = {"kind": kind, "stage": "rate", "step": step, "time_s": time_s}
    return entry if value is None else {**entry, "value": float(value)}
