"""Settings of a station's virtual bench, taken from the files and the request of a run."""

import random
import zlib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from calstation.config import STATION_ENTRIES, PairConfiguration, RunConfiguration
from calstation.devices.profiles import TableProfile
from calstation.errors import InputError
from calstation.physics import TEMPERATURES
from calstation.records import open_log

#: Folder of the flash memories of the units, next to the runs.
_FLASH_FOLDER = "bench"

#: Seed of a bench whose file does not specify one.
DEFAULT_SEED = 1

#: Largest clock drift of the units after the first, ppm.
_CLOCK_DRIFT = 20.0

#: Settings in a station file that apply to the first unit only.
_FIRST_UNIT_KEYS = ("serial", "orders")

#: Settings that secondaries on one body share with the primary.
_BODY_KEYS = ("seed", "speed", "body", "grade", "instability", "imu_transport", "ready_time_s")

#: Bench settings as JSON values, see `BenchConfig`.
Settings = dict[str, Any]


def bench_config(*setups: RunConfiguration) -> Settings:
    """Return the configuration of the bench process for these units on one table."""
    first, *others = (_unit_config(setup, bench_settings(setup)) for setup in setups)
    if not others:
        return first
    drifts = (random.Random(unit["seed"]).uniform(-_CLOCK_DRIFT, _CLOCK_DRIFT) for unit in others)
    other_units = [{"clock_drift_ppm": d, **unit, "orders": []} for d, unit in zip(drifts, others, strict=True)]
    numbers = [setup.number for setup in setups]
    # the settings of the first unit contain the faults of all units
    secondaries = [{**unit, "unit": number} for unit, number in zip(other_units, numbers[1:], strict=True)]
    return {**first, "unit": numbers[0], "secondaries": secondaries}


def pair_bench_config(setup: PairConfiguration) -> Settings:
    """Return the configuration of the bench process for the IMUs on one body."""
    bench = setup.primary.station.bench or {}
    shared = {name: value for name, value in bench.items() if name in _BODY_KEYS}
    settings: Any = bench.get("secondaries", [])
    secondaries = []
    for index, unit in enumerate(setup.secondaries):
        section = {**shared, **(settings[index] if index < len(settings) else {})}
        secondaries.append(_unit_config(unit, _settings(unit, section)))
    return {**bench_config(setup.primary), "secondaries": secondaries}


def bench_settings(setup: RunConfiguration) -> Settings:
    """Return the bench settings for a site, table and unit; the station file and then the request override them."""
    bench: Settings = dict(setup.station.bench or {})
    if setup.slot is not None:
        number = setup.station.slot_names.index(setup.slot.name)
        excluded = ("secondaries", *(_FIRST_UNIT_KEYS if number else ()))
        units = [{}, *bench.get("secondaries", ())]
        shared = {name: value for name, value in bench.items() if name not in excluded}
        bench = shared | (units[number] if number < len(units) else {})
    return _settings(setup, bench)


def _unit_config(setup: RunConfiguration, settings: Settings) -> Settings:
    """Return the settings of a unit with a seed that depends on its serial number."""
    seed = zlib.crc32(f"{settings.get('seed', DEFAULT_SEED)} {settings['serial']}".encode())
    return {**settings, "seed": seed, **setup.bench_overrides}


def _settings(setup: RunConfiguration, bench: Mapping[str, Any]) -> Settings:
    """Return the settings of a unit; `bench` is its section of the station file."""
    site, table, stream = setup.station.site, setup.table, setup.imu.stream
    settings: Settings = {
        "grade": setup.product.bench_grade,
        "serial": setup.request.serial,
        "table_protocol": "drives" if table.two_drives else table.protocol,
        "imu_protocol": setup.imu.protocol,
        "sample_rate_hz": stream.sample_rate_hz,
        "output": stream.output,
        "after_registers": setup.after_registers,
        "thermal_registers": TEMPERATURES[0] in setup.register_map.parameters,
        "outer_lever": table.outer_lever,
        "latitude_deg": site.latitude_deg,
        "height_m": site.height_m,
        "azimuth_deg": site.azimuth_deg or 0.0,
        "gravity_mps2": site.gravity_mps2,
        "outer_axis": table.outer_axis,
        "inner_axis": table.inner_axis,
        "low_deg": [table.outer.low_deg, table.inner.low_deg],
        "high_deg": [table.outer.high_deg, table.inner.high_deg],
        **_gimbal(table),
        **({} if setup.chamber is None else {"chamber": _chamber(setup)}),
        **({} if setup.slot is None else {"orientation": setup.slot.orientation, "lever_m": setup.slot.lever_m}),
        **{name: value for name, value in bench.items() if name not in (*STATION_ENTRIES, "chamber")},
    }
    if setup.request.seed is not None:
        settings["seed"] = setup.request.seed
    if setup.request.resume is not None:
        settings["interruptions"] = _interruptions(setup.request.resume)
    if setup.request.speed is not None:
        settings["speed"] = setup.request.speed
    flash = f"{quote(str(settings['serial']), safe='')}_{settings.get('seed', DEFAULT_SEED)}.flash"
    return {"flash_file": str(setup.request.out / _FLASH_FOLDER / flash), **settings}


def _interruptions(log: Path) -> int:
    """Return how often a resumed run was interrupted, from its log; every part of a run has different noise."""
    count, name = 1, log.name
    with suppress(InputError):  # an earlier log may have been deleted
        while (run := open_log(log.with_name(name)).meta.run) is not None and run.resumed_from:
            count, name = count + 1, run.resumed_from
    return count


def _chamber(setup: RunConfiguration) -> Settings:
    """Return the settings of the chamber, whose room has the station's ambient temperature."""
    section, profile = setup.station.chamber, setup.chamber
    given: Any = (setup.station.bench or {}).get("chamber", {})
    room = {} if section is None else {"room_c": section.ambient_c}
    rate = {} if profile is None else {"rate_c_per_min": profile.max_rate_c_per_min}
    return {**room, **rate, **given}


def _gimbal(table: TableProfile) -> Settings:
    """Return the settings of a gimbal; {} for a table."""
    gimbal = table.geometry().gimbal
    if gimbal is None:
        return {}
    travel = float(np.rad2deg(max(abs(end) for ends in gimbal.travel for end in ends)))
    return {"joint_order": gimbal.order, "joint_travel_deg": travel}
