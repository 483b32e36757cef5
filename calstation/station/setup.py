"""All of a run's configuration, read and checked before anything is opened or moves."""

import re
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from calstation import __version__
from calstation.configuration import validate
from calstation.devices.channels import span
from calstation.devices.imu_checks import check_baud
from calstation.devices.imu_profile import ImuProfile, load_imu_profile
from calstation.devices.opening import SOCKETS
from calstation.devices.table_profile import TableProfile, load_table_profile
from calstation.errors import ConfigurationError
from calstation.estimation.stage_data import BIAS_SIGMAS, SLOWEST
from calstation.physics.earth import normal_gravity
from calstation.physics.motion import Step
from calstation.physics.parameters import group_indices
from calstation.records.meta import (
    FileSection,
    ImuSection,
    LogMeta,
    PriorSection,
    ProductSection,
    RunSection,
    TableSection,
    context_from_meta,
    prior_from_meta,
)
from calstation.sequencer.acquisition import StatusMasks
from calstation.sequencer.preflight import PreflightLimits
from calstation.sequencer.stop_rule import StopRule, named
from calstation.sequencer.task import Output, StagePlan, Task
from calstation.station import library, version_store
from calstation.station.config import (
    ProductConfig,
    StationConfig,
    load_product,
    load_station,
    schedule_values,
)
from calstation.station.fault_plan import FaultPlan, load_fault_plan
from calstation.station.place import check_confirmed, check_place
from calstation.station.register_room import register_room
from calstation.station.request import RunRequest
from procedures import method

_PLAUSIBLE = 3.0
"""A register further from zero than this many sigmas of its parameter's prior holds no calibration of the unit."""

_SEED = 1
"""Of a virtual bench whose file names none."""


class HandsError(ConfigurationError):
    """Rails that hands turn and stages that are carried do not come together.

    by_hand : the station's rig is turned by hand and a stage needs one that is driven; or the other way round
    """

    def __init__(self, text: str, *, by_hand: bool = False) -> None:
        super().__init__(text)
        self.by_hand = by_hand


@dataclass(frozen=True)
class Setup:
    """A checked run: its request, configuration files and profiles; `schedules` by stage, validated.

    texts, files : of the station, product, table and imu files
    faults : what is to go wrong on the virtual bench
    """

    request: RunRequest
    station: StationConfig
    product: ProductConfig
    table: TableProfile
    imu: ImuProfile
    stages: tuple[str, ...]
    schedules: dict[str, BaseModel]
    texts: dict[str, str]
    files: dict[str, FileSection] = field(default_factory=dict)
    faults: FaultPlan = field(default_factory=FaultPlan)

    @property
    def after_registers(self) -> bool:
        """Whether the unit's stream is already corrected by its registers."""
        return self.imu.stream.order == "after_registers"

    @property
    def corrected(self) -> Output:
        """Whether and how the unit shows what it makes of its registers."""
        if self.after_registers:
            return Output.ALWAYS
        return Output.NEVER if self.imu.corrected is None else Output.ASKED

    @property
    def repeatability(self) -> float:
        """How far apart a table stands after two moves to the same angle, one sigma, rad."""
        accuracy = self.table.accuracy
        return float(np.deg2rad(accuracy.repeatability_deg or accuracy.encoder_sigma_deg))

    @property
    def by_hand(self) -> bool:
        """Whether the operator carries the unit and nothing drives it."""
        return self.table.by_hand

    def meta(self, started: datetime, attempt: int, registers: dict[str, float]) -> LogMeta:
        """The log's configuration: all that solving needs.

        `registers` : the unit's, by parameter, SI; {} where it could not be asked. Behind them (a stream after
        the registers) parameters are zero until found; before them, the registers' values are what the unit's
        parameters are worth until found again, unless they are no such unit's values at all.
        """
        profile, accuracy, stream, noise = self.imu, self.table.accuracy, self.imu.stream, self.imu.noise
        return LogMeta(
            site=self.station.site,
            imu=ImuSection(
                serial=self.request.serial,
                sample_rate_hz=stream.sample_rate_hz,
                output=stream.output,
                gyro_lsb=stream.gyro_lsb,
                accel_lsb=stream.accel_lsb,
                gyro_arw=noise.gyro_arw,
                accel_vrw=noise.accel_vrw,
                gyro_bias_instability=noise.gyro_bias_instability,
                accel_bias_instability=noise.accel_bias_instability,
            ),
            table=TableSection(
                outer_axis=self.table.outer_axis,
                inner_axis=self.table.inner_axis,
                outer_lever=self.table.outer_lever,
                encoder_sigma_deg=accuracy.encoder_sigma_deg,
                mount_sigma_deg=accuracy.mount_sigma_deg,
                azimuth_sigma_deg=accuracy.azimuth_sigma_deg,
                base_tilt_sigma_deg=accuracy.base_tilt_sigma_deg,
                velocity_sigma=accuracy.velocity_sigma,
                velocity_interval_s=accuracy.velocity_interval_s,
            ),
            prior={
                name: PriorSection(value=self._present(registers.get(name, 0.0), sigma), sigma=sigma)
                for name, sigma in profile.prior_sigmas().items()
            },
            product=ProductSection(
                name=self.product.name,
                limits=self.product.limits,
                targets=self.product.targets,
                checks=self.product.checks,
            ),
            run=RunSection(
                stages=list(self.stages),
                station=self.station.name,
                operator=self.request.operator,
                seed=self.bench_seed,
                attempt=attempt,
                software=__version__,
                started_utc=started.astimezone(UTC).isoformat(timespec="seconds"),
                files=self.files or None,
            ),
            schedule={stage: s.model_dump(mode="json") for stage, s in self.schedules.items()},
            profiles=self.texts,
            registers=registers if self.after_registers else {},
        )

    def _present(self, register: float, sigma: float) -> float:
        """A register's value as the mean of a prior, where it may be one; 0 otherwise."""
        return register if not self.after_registers and abs(register) <= _PLAUSIBLE * sigma else 0.0

    @property
    def bench_seed(self) -> int | None:
        """Seed of the virtual bench as it was given, None on hardware."""
        words = self.bench_words()
        return None if words is None else int(words.get("seed", _SEED))

    def bench_config(self) -> dict[str, Any] | None:
        """What the bench process is told; its seed is drawn from the one given and the unit's serial number, so that
        every number is a unit of its own and the same number is the same unit again."""
        words = self.bench_words()
        if words is None:
            return None
        drawn = zlib.crc32(f"{words.get('seed', _SEED)} {words['serial']}".encode())
        return self.faults.bench({**words, "seed": drawn})

    def bench_words(self) -> dict[str, Any] | None:
        """This site, table and unit for the bench, then the station file's own words, then the request's."""
        if self.station.bench is None:
            return None
        site, table, stream = self.station.site, self.table, self.imu.stream
        told: dict[str, Any] = {
            "grade": self.product.bench_grade,
            "serial": self.request.serial,
            "table_protocol": "drives" if table.map.inner_apart else table.protocol,
            "imu_protocol": self.imu.protocol,
            "sample_rate_hz": stream.sample_rate_hz,
            "output": stream.output,
            "behind_registers": self.after_registers,
            "outer_lever": table.outer_lever,
            "latitude_deg": site.latitude_deg,
            "height_m": site.height_m,
            "azimuth_deg": site.azimuth_deg or 0.0,
            "gravity_mps2": site.gravity_mps2,
            "outer_axis": table.outer_axis,
            "inner_axis": table.inner_axis,
            "low_deg": [table.outer.low_deg, table.inner.low_deg],
            "high_deg": [table.outer.high_deg, table.inner.high_deg],
            **{name: value for name, value in self.station.bench.items() if name != "faults"},
        }
        if self.request.seed is not None:
            told["seed"] = self.request.seed
        if self.request.speed is not None:
            told["speed"] = self.request.speed
        return told

    def task(self, meta: LogMeta) -> Task:
        """What the sequencer is to do."""
        context = context_from_meta(meta)
        geometry = self.table.geometry()
        gravity = context.site.gravity or normal_gravity(context.site.latitude, context.site.height)
        prior, biases = prior_from_meta(meta), group_indices("gyro_bias")
        room = BIAS_SIGMAS * prior.sigma[biases] + SLOWEST
        warm_up, load, status = self.product.warm_up, self.product.load_angle, self.imu.status
        return Task(
            stages=tuple(StagePlan(s, self._steps(s), _stop_rule(self.schedules[s])) for s in self.stages),
            preflight=PreflightLimits(
                serial=self.request.serial,
                serial_pattern=self.product.serial_pattern,
                gravity=gravity,
                rate_low=prior.mean[biases] - room,
                rate_high=prior.mean[biases] + room,
                warm_up=warm_up.time_s,
                warm_up_slope=warm_up.slope_c_per_min,
                warm_up_timeout=warm_up.timeout_s,
                by_hand=self.by_hand,
            ),
            geometry=geometry,
            imu=context.imu,
            masks=StatusMasks(status.ready, status.saturated, status.failed),
            span=span(self.imu.frame),
            corrected=self.corrected,
            latency=self.table.accuracy.poll_latency_s,
            settle=self.table.settle_s,
            load_angle=(float(np.deg2rad(load.outer_deg)), float(np.deg2rad(load.inner_deg))),
        )

    def _steps(self, stage: str) -> "_Steps":
        return _Steps(self, stage)


@dataclass(frozen=True)
class _Steps:
    """A fresh plan of a stage at every call."""

    setup: Setup
    stage: str

    def __call__(self) -> Iterator[Step]:
        return method(self.stage).plan(self.setup.table.geometry(), self.setup.schedules[self.stage])


def prepare(request: RunRequest) -> Setup:
    """Read and check everything that a run needs. Raises ConfigurationError with file, field and mend."""
    setup, product_path = configured(request)
    _check_serial(setup, product_path)
    check_station(setup, product_path)
    for stage in setup.stages:
        chosen = method(stage)
        if chosen.needs_no_table:  # some of these no table can drive at all
            next(chosen.plan(setup.table.geometry(), setup.schedules[stage]), None)
    return setup


def configured(request: RunRequest) -> tuple[Setup, Path]:
    """A run's configuration, checked, and the product's file; no unit needs to be named yet.

    Raises ConfigurationError with file, field and mend.
    """
    station_path, station = load_station(request.station)
    product_path, product = load_product(request.product)
    if not product.limits:
        raise ConfigurationError(
            f"{product_path}: has no limits; add [limits.NAME] before a unit is judged by it"
        )
    table_path = library.find("tables", station.table.profile)
    imu_path = library.find("imus", product.imu)
    stages = request.stages or tuple(product.stages)
    chosen = request.schedule or {}
    paths = {"station": station_path, "product": product_path, "table": table_path, "imu": imu_path}
    texts = {kind: path.read_bytes().decode() for kind, path in paths.items()}
    setup = Setup(
        request=request,
        station=station,
        product=product,
        table=load_table_profile(table_path),
        imu=load_imu_profile(imu_path),
        stages=stages,
        schedules={stage: _schedule(product, stage, chosen.get(stage, {}), product_path) for stage in stages},
        texts=texts,
        files={kind: _file(kind, path, texts[kind]) for kind, path in paths.items()},
    )
    faults = _faults(setup, station_path)
    setup = replace(setup, faults=faults, station=faults.station(station))
    _check_bench(setup, station_path)
    for place, words in register_room(product, setup.imu):
        raise ConfigurationError(f"{product_path}: {'.'.join(place)} {words}")
    _check_line(setup, station_path)
    _check_targets("targets", product.targets, product_path)
    for stage, schedule in setup.schedules.items():
        _check_targets(f"schedule.{stage}.targets", getattr(schedule, "targets", {}), product_path)
    return setup, product_path


def check_station(setup: Setup, product_path: Path) -> None:
    """Whether the product can be calibrated at this station: its rig, and how well its place is known.

    Raises ConfigurationError with field and mend, HandsError where it is the rig.
    """
    check_hands(setup, product_path)
    meta, path = setup.meta(datetime.now(UTC), 1, {}), load_station(setup.request.station)[0]
    check_place(meta, path)
    if setup.station.bench is None:
        check_confirmed(meta, path)


def check_hands(setup: Setup, product_path: Path) -> None:
    """Rails that hands turn need stages that are carried, and carried stages need such rails.

    Raises HandsError with the stage and the mend.
    """
    rig = setup.table.name
    for stage, schedule in setup.schedules.items():
        manual = getattr(schedule, "manual", None)
        if setup.by_hand and manual is None:
            raise HandsError(
                f"stages: '{stage}' needs a table that is driven, but '{rig}' of station '{setup.station.name}' is"
                " turned by hand; choose multi_position, or another station",
                by_hand=setup.by_hand,
            )
        if setup.by_hand and not manual:
            raise HandsError(
                f"{product_path}: schedule.{stage}.manual must be true, because '{rig}' of station"
                f" '{setup.station.name}' is turned by hand; set it, or choose another product or station",
                by_hand=setup.by_hand,
            )
        if manual and not setup.by_hand:
            raise HandsError(
                f"{product_path}: schedule.{stage}.manual is true, but the table '{rig}' of station"
                f" '{setup.station.name}' is driven; choose a station with rails turned by hand, or another product",
                by_hand=setup.by_hand,
            )


def _file(kind: str, path: Path, text: str) -> FileSection:
    """Which file it is, and which of its saved versions."""
    version = version_store.number_of(f"{kind}s", path.stem, text)
    return FileSection(name=path.stem, version=version, sha256=version_store.sha256(text))


def _check_line(setup: Setup, station_path: Path) -> None:
    """A place's own baud carries the unit's stream; of a socket nobody knows."""
    own, port = setup.station.imu.serial, setup.station.imu.port or ""
    if own is None or "baud" not in own.model_fields_set or port.startswith(SOCKETS):
        return
    try:
        check_baud(own, setup.imu.frame, setup.imu.stream.sample_rate_hz)
    except ValueError as exc:
        raise ConfigurationError(
            f"{station_path}: imu.serial: {str(exc).replace('link.baud', 'baud')}"
        ) from None


def _check_targets(field: str, targets: Iterable[str], product_path: Path) -> None:
    """A target of no parameter would count as reached at once."""
    for name in targets:
        if not named(name):
            raise ConfigurationError(f"{product_path}: {field}.{name} is no parameter or group; remove it")


def _check_serial(setup: Setup, product_path: Path) -> None:
    pattern = setup.product.serial_pattern
    if not re.fullmatch(pattern, setup.request.serial):
        raise ConfigurationError(
            f"--serial '{setup.request.serial}' does not fit the pattern '{pattern}' of {product_path}; "
            "correct the number or choose another --product"
        )


def _faults(setup: Setup, station_path: Path) -> FaultPlan:
    """The plan of the request, or that named beside the station file's bench."""
    path = setup.request.faults
    if setup.station.bench is None:
        if path is not None:
            raise ConfigurationError(
                f"--faults belongs to the virtual bench; {station_path} is hardware, leave it out"
            )
        return FaultPlan()
    named = setup.station.bench.get("faults")
    if path is None and named is not None:
        path = station_path.parent / str(named)
    return FaultPlan() if path is None else load_fault_plan(path)


def _check_bench(setup: Setup, station_path: Path) -> None:
    config = setup.bench_words()
    if config is None:
        for option, value in (("--speed", setup.request.speed), ("--seed", setup.request.seed)):
            if value is not None:
                raise ConfigurationError(
                    f"{option} belongs to the virtual bench; {station_path} is hardware, leave it out"
                )
        return
    from calstation.bench.config import BenchConfig

    validate(BenchConfig, setup.faults.bench(config), f"{station_path} [bench]")


def _schedule(product: ProductConfig, stage: str, instead: Mapping[str, Any], path: Path) -> BaseModel:
    """A stage's schedule, checked. Raises ConfigurationError naming file, field and mend."""
    given = schedule_values(product, stage, instead)
    return validate(method(stage).schedule, given, f"{path}: schedule.{stage}")


def _stop_rule(schedule: BaseModel) -> StopRule:
    """The stop rule in a schedule; a plan that does not repeat has none."""
    return StopRule(
        rounds=getattr(schedule, "rounds", None),
        duration=getattr(schedule, "duration_s", None),
        targets=getattr(schedule, "targets", {}),
    )
