"""Plans of the runs of a soak test (devices, unit and faults), and the files that configure them."""

import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import tomli_w

from calstation.bench.imu import UNITS
from calstation.config import DEFAULT_PRODUCT, DEFAULT_STATION, RunRequest, library
from calstation.devices.profiles import load_table_profile
from calstation.schema import read_toml
from calstation.simulation.fault_plan import CAPTURES

STAGES = ("rate", "six_position")
_QUICK = {"rate_dps": 100.0, "acceleration_dps2": 100.0}
_SHORT: dict[str, Any] = {
    "warm_up": {"time_s": 0.0},
    "schedule": {"rate": {"turns": 1, "dwell_s": 2.0, **_QUICK}, "six_position": {"dwell_s": 6.0, **_QUICK}},
}

#: Name of the default devices, a table over Modbus TCP and a framed unit.
_DEFAULT_DEVICES = "default"


@cache
def devices() -> Mapping[str, tuple[int, dict[str, Any], dict[str, Any]]]:
    """Return the weight in the random draw and the changes to station and product files, by name of the devices.

    They are the default devices, every other shipped table with two driven axes, and the unit of every other protocol.
    """
    choices: dict[str, tuple[int, dict[str, Any], dict[str, Any]]] = {
        _DEFAULT_DEVICES: (8, {}, {}),
        "Modbus RTU": (1, {"bench": {"table_transport": "rtu"}}, {}),
    }
    for path in sorted((library.shipped_folder() / "tables").glob("*.toml")):
        table = load_table_profile(path)
        if path.stem != "bench" and not table.by_hand and table.gimbal is None:
            choices[path.stem] = (1, {"table": {"profile": path.stem}}, {})
    for protocol, unit in UNITS.items():
        if protocol != "framed":
            choices[unit.profile] = (1, {}, {"imu": unit.profile, "bench_grade": "mems", "limits": "mems_c"})
    return choices


#: Faults (kind, value) that a run tolerates: with only these, the run of a good unit must end with a verdict.
TOLERATED_FAULTS: tuple[tuple[str, float | None], ...] = (
    ("corrupt_frames", 3),
    ("drop_frames", 3),
    ("duplicate_frames", 2),
    ("reorder_frames", 2),
    ("noise_bytes", 4),
    ("jump_counter", 65_500),
    ("silence_imu", 0.4),
    ("garble_imu", 0.3),
    ("saturate_imu", 0.3),
    ("invalid_imu", 0.3),
    ("reset_imu", None),
    ("mute_table", 2),
    ("slow_table", 0.3),
    ("slow_imu", 1.2),
    ("garble_table", 1),
    ("refuse_table", 6),
)

#: Faults (kind, value) injected at a random time within a stage.
STAGE_FAULTS: tuple[tuple[str, float | None], ...] = (
    *TOLERATED_FAULTS,
    ("silence_imu", 600),
    ("garble_imu", 600),
    ("freeze_channel", 4),
    ("hang_up_imu", None),
    ("mute_table", 30),
    ("refuse_table", 4),
    ("interlock", 0),
    *((kind, None) for kind in ("drive_fault", "limit_fault", "stall", "trip_watchdog", "jam")),
    ("overshoot", 2),
    ("never_settle", 600),
    ("engine_killed", None),
)

#: Faults (kind, value) that are present from the start, have a trigger, or are caused by the observing process.
OTHER_FAULTS: tuple[tuple[str, float | None], ...] = (
    ("brown_out_write", 20),
    ("brown_out_commit", 70),
    ("brown_out_commit", 128),
    ("wrong_unit", None),
    ("mounted_otherwise", None),
    ("wrong_latitude", 2.0),
    ("wrong_gravity", None),
    *((kind, None) for kind in ("watchdog_off", "interlock_open", "never_ready", "operator_stop", "window_killed")),
)

#: Kinds that are also injected during the captures around a register transfer.
_IN_CAPTURES = ("reset_imu", "drop_frames")

#: Kinds of faults that the process observing the run causes.
OBSERVER_FAULTS = ("operator_stop", "window_killed")
#: Latest time of a fault after the start of its stage, device time, s.
_LATEST_TIME = 20.0


@dataclass(frozen=True)
class PlannedRun:
    """One run of a soak test: the seed of its bench, its faults (kind, value), and a key of `devices()`."""

    number: int
    seed: int
    faulty_unit: bool
    faults: tuple[tuple[str, float | None], ...]
    devices: str = _DEFAULT_DEVICES


def plans(runs: int, seed: int) -> Iterator[PlannedRun]:
    """Plan the runs; the same seed gives the same plan, and each fault occurs once before any is repeated."""
    generator = random.Random(seed)
    remaining: list[tuple[str, float | None]] = []
    for number in range(runs):
        count = generator.choices((0, 1, 2), (0.2, 0.65, 0.15))[0]
        faults: list[tuple[str, float | None]] = []
        for _ in range(count):
            if not remaining:
                remaining = [*STAGE_FAULTS, *OTHER_FAULTS]
                generator.shuffle(remaining)
            faults.append(remaining.pop())
        seed_of_run, faulty = generator.randrange(2**31), generator.random() < 0.1
        (devices_name,) = generator.choices(list(devices()), [weight for weight, _, _ in devices().values()])
        yield PlannedRun(number, seed_of_run, faulty, tuple(faults), devices_name)


def write_request(planned: PlannedRun, folder: Path, stages: tuple[str, ...]) -> RunRequest:
    """Write the station, product and fault-plan files of a run; return the request that uses them."""
    generator = random.Random(planned.seed)
    (folder / "bench").mkdir(parents=True, exist_ok=True)
    _, other_station, other_product = devices()[planned.devices]
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
        product.pop("checks", None)  # the checks refer to omitted stages and to the full schedule
    names = tuple(product["stages"])
    faults = [_fault(kind, value, names, generator) for kind, value in planned.faults if kind not in OBSERVER_FAULTS]
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


def _fault(kind: str, value: float | None, stages: tuple[str, ...], generator: random.Random) -> dict[str, Any]:
    entry: dict[str, Any] = {"kind": kind} if value is None else {"kind": kind, "value": float(value)}
    if (kind, value) in STAGE_FAULTS:
        entry["stage"] = generator.choice((*stages, *CAPTURES) if kind in _IN_CAPTURES else stages)
        if entry["stage"] not in CAPTURES and generator.random() < 0.5:
            entry["step"] = generator.randrange(6)
        entry["time_s"] = generator.uniform(0.0, _LATEST_TIME if "step" not in entry else 3.0)
    return entry


def _write(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(tomli_w.dumps(dict(content)), encoding="utf-8")
