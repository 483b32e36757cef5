"""A checked run: its configuration, and what each part of the program needs of it."""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import numpy as np
from pydantic import BaseModel

from calstation import __version__
from calstation.config.request import RunRequest
from calstation.config.station import (
    ProductConfig,
    StationConfig,
)
from calstation.devices.imu.sample_count import wrap
from calstation.devices.profiles.channels import span
from calstation.devices.profiles.imu import ImuProfile
from calstation.devices.profiles.table import TableProfile
from calstation.estimation.common.stage_data import BIAS_SIGMAS, SLOWEST
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
from calstation.sequencer.stop_rule import StopRule
from calstation.sequencer.task import Output, StagePlan, Task
from calstation.simulation.fault_plan import FaultPlan
from procedures import method

#: A register further from zero than this many sigmas of its parameter's prior holds no calibration of the unit.
_PLAUSIBLE = 3.0

#: Of a virtual bench whose file names none.
_SEED = 1


@dataclass(frozen=True)
class ResolvedConfiguration:
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
            site=self.station.site.place,
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
            wrap=wrap(self.imu.frame),
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

    setup: ResolvedConfiguration
    stage: str

    def __call__(self) -> Iterator[Step]:
        return method(self.stage).plan(self.setup.table.geometry(), self.setup.schedules[self.stage])


def _stop_rule(schedule: BaseModel) -> StopRule:
    """The stop rule in a schedule; a plan that does not repeat has none."""
    return StopRule(
        rounds=getattr(schedule, "rounds", None),
        duration=getattr(schedule, "duration_s", None),
        targets=getattr(schedule, "targets", {}),
    )
