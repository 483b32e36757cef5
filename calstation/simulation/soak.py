"""Calibrations back to back on the virtual bench with random faults, judged by the bench's own truth."""

import random
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomli_w

from calstation.config import library
from calstation.config.request import RunRequest
from calstation.config.station import DEFAULT_PRODUCT, DEFAULT_STATION
from calstation.errors import ConfigurationError
from calstation.results.handover import deliver_pending
from calstation.runs.engine import Engine
from calstation.schema import read_toml
from calstation.sequencer.control import Command
from calstation.sequencer.events import StepStarted
from calstation.simulation.fault_plan import CAPTURES
from calstation.simulation.hooks import BenchHooks
from calstation.simulation.soak_judge import MILD, Judged, judge_run

STAGES = ("rate", "six_position")
_QUICK = {"rate_dps": 100.0, "acceleration_dps2": 100.0}
_SHORT: dict[str, Any] = {
    "warm_up": {"time_s": 0.0},
    "schedule": {
        "rate": {"turns": 1, "dwell_s": 2.0, **_QUICK},
        "six_position": {"dwell_s": 6.0, **_QUICK},
    },
}
_MEMS = {"bench_grade": "mems", "limits": "mems_c"}

#: What a station may have: how often in how many, and what its files then say otherwise.
DEVICES: Mapping[str, tuple[int, dict[str, Any], dict[str, Any]]] = {
    "Modbus TCP, frames": (8, {}, {}),
    "Modbus RTU": (1, {"bench": {"table_transport": "rtu"}}, {}),
    "two drives": (1, {"table": {"profile": "cia402_drives"}}, {}),
    "ATL": (1, {"table": {"profile": "aerosmith_atl"}}, {}),
    "ACL": (1, {"table": {"profile": "acutronic_acl"}}, {}),
    "MN": (1, {"table": {"profile": "mn_ascii"}}, {}),
    "indexing unit": (1, {"table": {"profile": "indexing_unit"}}, {}),
    "VN-100": (1, {}, {"imu": "vectornav_vn100", **_MEMS}),
    "DSP by Modbus": (1, {}, {"imu": "dsp_modbus", **_MEMS}),
}

#: Kinds with values that strike in the middle of a stage, at a random second.
STAGE_FAULTS: tuple[tuple[str, float | None], ...] = (
    *MILD,
    ("silence_imu", 600),
    ("garble_imu", 600),
    ("freeze_channel", 4),
    ("hang_up_imu", None),
    ("mute_table", 30),
    ("refuse_table", 4),
    ("interlock", 0),
    ("drive_fault", None),
    ("limit_fault", None),
    ("stall", None),
    ("trip_watchdog", None),
    ("jam", None),
    ("overshoot", 2),
    ("never_settle", 600),
    ("engine_killed", None),
)

#: Kinds that are so from the start, strike when their moment comes, or come from the listener.
OTHER_FAULTS: tuple[tuple[str, float | None], ...] = (
    ("brown_out_write", 20),
    ("brown_out_commit", 70),
    ("brown_out_commit", 128),
    ("wrong_unit", None),
    ("mounted_otherwise", None),
    ("wrong_latitude", 2.0),
    ("wrong_gravity", None),
    ("watchdog_off", None),
    ("interlock_open", None),
    ("never_ready", None),
    ("operator_stop", None),
    ("window_killed", None),
)

#: Kinds of the former that also strike while the unit is looked at, around the transfer of its registers.
_IN_LOOKS = ("reset_imu", "drop_frames")

_FROM_LISTENER = ("operator_stop", "window_killed")
#: Host time without the end of a run that counts as a hang, s; ten times of it for a whole schedule.
_HANGS_AFTER = 300.0

#: Besides a tenth, what a process may take until everything was used once, MB.
_GROWTH = 20.0
#: Seconds of device time into a stage, or a step of it, at most, at which faults strike.
_LATEST = 20.0


@dataclass(frozen=True)
class Planned:
    """One run of a soak: the bench's seed, what is wrong with the unit, what is to happen (kind, value).

    devices : of the station, one of `DEVICES`
    """

    number: int
    seed: int
    faulty_unit: bool
    faults: tuple[tuple[str, float | None], ...]
    devices: str = "Modbus TCP, frames"


@dataclass
class Soak:
    """What came of the runs so far.

    Attributes
    ----------
    runs : judged, in order
    undelivered : results that did not reach the hand-over folder
    """

    runs: list[Judged] = field(default_factory=list)
    undelivered: int = 0

    def counts(self) -> dict[str, Any]:
        """The totals that a soak is about, JSON-ready."""
        injected = Counter(kind for run in self.runs for kind in run.injected)
        return {
            "runs": len(self.runs),
            "outcomes": dict(Counter(run.outcome for run in self.runs)),
            "devices": dict(Counter(run.planned.devices for run in self.runs)),
            "faults": {
                kind: {
                    "injected": count,
                    "recovered": sum(kind in run.injected and run.recovered for run in self.runs),
                    "stopped_safely": sum(kind in run.injected and run.stopped_safely for run in self.runs),
                }
                for kind, count in sorted(injected.items())
            },
            "faults_injected": sum(injected.values()),
            "recovered": sum(run.recovered for run in self.runs),
            "stopped_safely": sum(run.stopped_safely for run in self.runs),
            "wrong_verdicts": sum(bool(run.wrong) for run in self.runs),
            "unsafe": sum(run.unsafe for run in self.runs),
            "hung": sum(run.outcome == "hung" for run in self.runs),
            "samples": sum(run.samples for run in self.runs),
            "samples_lost": sum(run.samples_lost for run in self.runs),
            "lost_records": sum(bool(run.lost) for run in self.runs) + self.undelivered,
            "engine_memory_mb": _trend([run.engine_mb for run in self.runs]),
            "parent_memory_mb": _trend([run.parent_mb for run in self.runs]),
            "seconds_per_run": _mean([run.seconds for run in self.runs]),
            "problems": [
                {
                    "run": run.planned.number,
                    "seed": run.planned.seed,
                    "devices": run.planned.devices,
                    "faults": list(run.injected),
                    "what": what,
                }
                for run in self.runs
                for what in (*run.wrong, *run.lost, *(["table not left safe"] if run.unsafe else []))
            ],
        }

    @property
    def sound(self) -> bool:
        """Nothing wrong, lost, unsafe or hung, and no growth of what lives through all runs."""
        counts = self.counts()
        memory = counts["parent_memory_mb"]
        grown = memory["last"] > 1.1 * memory["first"] + _GROWTH
        return not grown and not any(
            counts[name] for name in ("wrong_verdicts", "lost_records", "unsafe", "hung")
        )


def plans(runs: int, seed: int) -> Iterator[Planned]:
    """What is to happen, the same for the same seed; every kind comes before any comes again."""
    drawn = random.Random(seed)
    deck: list[tuple[str, float | None]] = []
    for number in range(runs):
        wanted = drawn.choices((0, 1, 2), (0.2, 0.65, 0.15))[0]
        faults: list[tuple[str, float | None]] = []
        for _ in range(wanted):
            if not deck:
                deck = [*STAGE_FAULTS, *OTHER_FAULTS]
                drawn.shuffle(deck)
            faults.append(deck.pop())
        seed_of_run, faulty = drawn.randrange(2**31), drawn.random() < 0.1
        (devices,) = drawn.choices(list(DEVICES), [often for often, _, _ in DEVICES.values()])
        yield Planned(number, seed_of_run, faulty, tuple(faults), devices)


def soak(
    runs: int,
    seed: int,
    folder: Path,
    *,
    full: bool,
    on_run: Callable[[Soak], None],
    stopping: Callable[[], bool],
) -> Soak:
    """Run calibrations in `folder` until they are done or `stopping` says so; `on_run` hears of each.

    Raises ConfigurationError where the folder holds runs already, for they would be taken for this soak's.
    """
    if (folder / "runs").exists():
        raise ConfigurationError(f"--keep {folder}: holds runs already; give a folder without any")
    done = Soak()
    stages = () if full else STAGES
    for planned in plans(runs, seed):
        if stopping():
            break
        request = _written(planned, folder, stages)
        begin = time.monotonic()
        heard = _listen(request, planned, _HANGS_AFTER * (10.0 if full else 1.0))
        report = folder / "bench" / f"{planned.number}.json"
        seconds = time.monotonic() - begin
        done.runs.append(judge_run(planned, request, heard.hung, heard.memory, seconds, report))
        on_run(done)
    delivery = deliver_pending(lambda *_, **__: None, folder / "runs", folder / "station.toml")
    done.undelivered = delivery.waiting
    return done


@dataclass
class _Heard:
    """What a listener of a run noticed beside its events."""

    hung: bool = False
    memory: float = 0.0


def _listen(request: RunRequest, planned: Planned, patience: float) -> _Heard:
    heard, drawn = _Heard(), random.Random(planned.seed)
    kinds = [kind for kind, _ in planned.faults]
    moment = drawn.randrange(2, 15)
    steps = 0
    deadline = time.monotonic() + patience
    with Engine.start(request, BenchHooks) as engine:
        while not engine.ended:
            heard.memory = max(heard.memory, resident_mb(engine.process.pid))
            for event in engine.poll():
                if isinstance(event, StepStarted):
                    steps += 1
                    if steps == moment and "operator_stop" in kinds:
                        engine.send(Command.STOP)
                    if steps == moment and "window_killed" in kinds:
                        engine.hang_up()
            if time.monotonic() > deadline:
                heard.hung = True
                break
            time.sleep(0.05)
    return heard


def resident_mb(pid: int | None) -> float:
    """Resident memory of a process at its peak, MB; 0 where the system does not tell."""
    try:
        text = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    except OSError:
        return 0.0
    return next(
        (int(line.split()[1]) / 1024.0 for line in text.splitlines() if line.startswith("VmHWM")), 0.0
    )


def _written(planned: Planned, folder: Path, stages: tuple[str, ...]) -> RunRequest:
    """Station, product and plan of a run, as files; the request that uses them."""
    drawn = random.Random(planned.seed)
    (folder / "bench").mkdir(parents=True, exist_ok=True)
    _, other_station, other_product = DEVICES[planned.devices]
    station = read_toml(library.shipped_folder() / "stations" / f"{DEFAULT_STATION}.toml")
    station |= {name: section for name, section in other_station.items() if name != "bench"}
    station["bench"] = {
        "seed": planned.seed,
        "out_of_limits": planned.faulty_unit,
        "flash_file": str(folder / "bench" / f"{planned.number}.flash"),
        "report_file": str(folder / "bench" / f"{planned.number}.json"),
        **other_station.get("bench", {}),
    }
    product = _product(DEFAULT_PRODUCT) | other_product
    if other_product:
        product["limits"] = _product(other_product["limits"])["limits"]
    if stages:
        limits = {name: {"within": limit["within"]} for name, limit in product["limits"].items()}
        product |= {"name": "soak", **_SHORT, "limits": limits, "stages": list(stages)}
    names = tuple(product["stages"])
    faults = [
        _fault(kind, value, names, drawn) for kind, value in planned.faults if kind not in _FROM_LISTENER
    ]
    _write(folder / "station.toml", station)
    _write(folder / "product.toml", product)
    _write(folder / "plan.toml", {"seed": planned.seed, "fault": faults})
    return RunRequest(
        serial=f"SN-{planned.number:06d}",
        station=folder / "station.toml",
        product=folder / "product.toml",
        out=folder / "runs",
        operator="soak",
        faults=folder / "plan.toml",
    )


def _product(name: str) -> dict[str, Any]:
    return read_toml(library.shipped_folder() / "products" / f"{name}.toml")


def _fault(kind: str, value: float | None, stages: tuple[str, ...], drawn: random.Random) -> dict[str, Any]:
    entry: dict[str, Any] = {"kind": kind} if value is None else {"kind": kind, "value": float(value)}
    if (kind, value) in STAGE_FAULTS:
        entry["stage"] = drawn.choice((*stages, *CAPTURES) if kind in _IN_LOOKS else stages)
        if entry["stage"] not in CAPTURES and drawn.random() < 0.5:
            entry["step"] = drawn.randrange(6)
        entry["time_s"] = drawn.uniform(0.0, _LATEST if "step" not in entry else 3.0)
    return entry


def _write(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(tomli_w.dumps(dict(content)), encoding="utf-8")


def _mean(values: list[float]) -> float:
    return sum(values) / len(values) if values else 0.0


def _trend(values: list[float]) -> dict[str, float]:
    """Means of the first and the last tenth, and the largest."""
    tenth = max(1, len(values) // 10)
    return {
        "first": _mean(values[:tenth]),
        "last": _mean(values[-tenth:]),
        "largest": max(values, default=0.0),
    }
