"""The configuration of a virtual bench: its unit, site, table, transports and planned faults."""

from dataclasses import replace
from math import radians
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Annotated, Literal, get_args

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from calstation.bench.chamber import ChamberSettings
from calstation.bench.table import TableLimits
from calstation.bench.truth import (
    GRADES,
    BenchTruth,
    Effects,
    EncoderTruth,
    GimbalStream,
    GradeName,
    ImuTruth,
    ManualRig,
    TableMotion,
    TableTruth,
    ThermalSettings,
    UnitThermal,
    draw_imu,
    draw_power_ups,
    earth_rate_n,
    normal_gravity,
    unit_axes,
)
from calstation.physics import INDEX, group_indices
from calstation.schema import EntryError, near_miss

#: Groups of parameters that are 0 for units on a body, because a pair has only one lever arm.
_ZERO_ON_BODY = ("accel_quadratic", "inner_lever", "outer_lever")
_ARCSECOND = radians(1.0 / 3600.0)

Vector = tuple[float, float, float]
Pair = tuple[float, float]
NonNegative = Annotated[float, Field(ge=0.0)]
Positive = Annotated[float, Field(gt=0.0)]


def _known_parameter(name: str) -> str:
    if name not in INDEX:
        raise EntryError("entry.unknown_parameter", name=name, remedy=near_miss(name, INDEX))
    return name


def _valid_orientation(orientation: str) -> str:
    unit_axes(orientation)  # raises ValueError
    return orientation


#: Names of the protocols of simulated units, the modules of `bench.imu.units`.
IMU_PROTOCOLS = tuple(module.name for module in iter_modules([str(Path(__file__).parent / "imu" / "units")]))
if TYPE_CHECKING:
    ImuProtocolName = str
else:
    ImuProtocolName = Literal[IMU_PROTOCOLS]

ParameterName = Annotated[str, AfterValidator(_known_parameter)]

_Trip = Literal["interlock", "drive_fault", "limit_fault", "stall", "trip_watchdog"]
_Motion = Literal["jam", "overshoot", "never_settle"]
_Frames = Literal["corrupt_frames", "drop_frames", "duplicate_frames", "reorder_frames", "noise_bytes"]
_Samples = Literal["silence_imu", "garble_imu", "saturate_imu", "invalid_imu", "freeze_channel"]
_Unit = Literal["jump_counter", "reset_imu", "hang_up_imu", "slow_imu"]
_TableLink = Literal["mute_table", "slow_table", "garble_table", "refuse_table"]
_Chamber = Literal["chamber_alarm", "chamber_door", "chamber_off", "chamber_no_power", "chamber_set_point"]
_ChamberSensor = Literal["chamber_sensor_stuck", "chamber_sensor_offset"]
_ChamberLink = Literal["mute_chamber", "slow_chamber", "hang_up_chamber"]
_Temperature = Literal["temperature_stuck", "temperature_offset", "temperature_jump"]
_COMMON = (_Trip, _Motion, _TableLink, _Chamber, _ChamberSensor, _ChamberLink)
_COMMON_FAULTS = frozenset(name for kind in _COMMON for name in get_args(kind))
FaultName = Literal[
    _Trip,
    _Motion,
    _Frames,
    _Samples,
    _Unit,
    _TableLink,
    _Chamber,
    _ChamberSensor,
    _ChamberLink,
    _Temperature,
    "brown_out_write",
    "brown_out_commit",
]


class Settings(BaseModel):
    """A section of the configuration, without unknown entries."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class FaultCommand(Settings):
    """A command to inject a fault at device time `at`, s, or `after` a delay, s; see `docs/reference/bench.md`.

    `unit` is the number of the affected unit, which is ignored for the table and the chamber.
    """

    order: FaultName
    value: float = 1.0
    at: float = 0.0
    after: NonNegative = 0.0
    unit: Annotated[int, Field(ge=1)] = 1

    @property
    def affects_table(self) -> bool:
        """Whether the fault affects the table or the chamber instead of a unit."""
        return self.order in _COMMON_FAULTS


class BodySettings(Settings):
    """The motion of a body with several units: rests and motions of constant duration alternate."""

    rest_s: Positive = 8.0
    motion_s: Positive = 24.0
    seed: Annotated[int, Field(ge=0)] = 1


class BenchConfig(Settings):
    """Configuration of a bench, with angles in degrees; `docs/reference/bench.md` explains every entry."""

    grade: GradeName = "nav"
    seed: Annotated[int, Field(ge=0)] = 1
    parameters: dict[ParameterName, float] = Field(default_factory=dict)
    serial: str = "SN-000001"
    unit: Annotated[int, Field(ge=1)] = 1
    orientation: Annotated[str, AfterValidator(_valid_orientation)] = "+x+z"
    lever_m: Vector = (0.0, 0.0, 0.0)
    table_serial: str = "T-0001"
    speed: NonNegative = 0.0
    sample_rate_hz: Positive = 200.0
    output: Literal["increment", "rate"] = "increment"
    outer_lever: Literal["estimated", "fixed"] = "estimated"
    instability: bool = True
    out_of_limits: bool = False
    effects: Effects = Effects()

    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 34.25
    height_m: float = 400.0
    azimuth_deg: float = 0.0
    gravity_mps2: Positive | None = None

    outer_axis: Vector = (1.0, 0.0, 0.0)
    inner_axis: Vector = (0.0, 0.0, 1.0)
    mount_deg: Pair = (0.0, 1.0)
    azimuth_error_deg: NonNegative = 0.1
    base_tilt_deg: NonNegative = 0.1
    non_orthogonality_arcsec: NonNegative = 60.0
    wobble_arcsec: NonNegative = 1.0
    axis_offset_mm: float | Pair = 0.0
    encoder_sigma_deg: NonNegative = 0.05
    encoder_periodic_deg: NonNegative = 0.005
    encoder_noise_deg: NonNegative = 0.0005
    velocity_sigma: NonNegative = 1e-3
    table_motion: TableMotion = TableMotion()
    start_deg: Pair | None = None
    joint_order: str = "zxy"
    joint_travel_deg: Positive = 85.0
    low_deg: Pair = (-1080.0, -1080.0)
    high_deg: Pair = (1080.0, 1080.0)
    rate_deg_s: Positive = 120.0
    acceleration_deg_s2: Positive = 200.0
    homing_rate_deg_s: Positive = 5.0
    interlock_closed: bool = True
    watchdog_ms: Annotated[int, Field(ge=0, le=65535)] = 10_000

    table_protocol: Literal["modbus", "drives", "imu_link", "atl", "acl", "mn", "hand", "gimbal"] = "modbus"
    table_transport: Literal["tcp", "rtu"] = "tcp"
    imu_protocol: ImuProtocolName = "framed"
    imu_transport: Literal["socket", "pty"] = "socket"
    after_registers: bool = False
    latency_s: NonNegative = 0.002
    jitter_s: NonNegative = 0.001
    clock_drift_ppm: float = 20.0
    power_on_s: NonNegative = 0.0
    calibrated: bool = False
    gyro_steps: tuple[Pair, ...] = ()
    body: BodySettings | None = None
    chamber: ChamberSettings | None = None
    thermal_registers: bool = False
    thermal: ThermalSettings = ThermalSettings()
    secondaries: tuple["BenchConfig", ...] = ()
    ready_time_s: NonNegative = 1.0
    ambient_c: float = 23.0
    warm_up_c: float = 4.0
    warm_up_time_s: Positive = 30.0
    flash_file: Path | None = None
    interruptions: Annotated[int, Field(ge=0)] = 0
    flash_banks: Literal[1, 2] = 2
    orders: tuple[FaultCommand, ...] = ()
    report_file: Path | None = None

    @model_validator(mode="after")
    def _check_chamber(self) -> "BenchConfig":
        if self.chamber is not None and (self.body is not None or self.table_protocol in ("hand", "gimbal")):
            raise EntryError("bench.chamber_without_table", "chamber")
        return self

    @model_validator(mode="after")
    def _check_effects(self) -> "BenchConfig":
        if self.effects != Effects() and (self.body is not None or self.table_protocol in ("hand", "gimbal")):
            raise EntryError("bench.effects_without_table", "effects")
        return self

    @model_validator(mode="after")
    def _check_units(self) -> "BenchConfig":
        known = {self.unit, *(other.unit for other in self.secondaries)}
        for number, order in enumerate(self.orders):
            if self.secondaries and not order.affects_table and order.unit not in known:
                raise EntryError("bench.no_such_unit", "orders", number, "unit", unit=order.unit)
        return self

    def truth(self, flash_cycles: int = 0) -> BenchTruth:
        """Draw the true values of the bench from this configuration and its seed.

        `flash_cycles` is the number of writes to the unit's flash, which equals the number of power-ups since the first
        run; the unit's errors change at each power-up by the repeatability of its grade.
        """
        unit_seed, table_seed = np.random.SeedSequence(self.seed).spawn(2)
        imu = draw_imu(
            self.grade,
            np.random.default_rng(unit_seed),
            sample_rate=self.sample_rate_hz,
            output=self.output,
            outer_lever=self.outer_lever,
            instability=self.instability,
            out_of_limits=self.out_of_limits,
        )
        if flash_cycles and self.instability:
            drift = draw_power_ups(self.grade, np.random.default_rng([self.seed, 2]), flash_cycles)
            imu.parameters[:] += drift
        imu.parameters[group_indices("outer_lever")] += self.lever_m
        for name, value in self.parameters.items():
            imu.parameters[INDEX[name]] = value
        if self.body is not None:
            imu.parameters[[i for group in _ZERO_ON_BODY for i in group_indices(group)]] = 0.0
        imu = replace(
            imu,
            gyro_arw=imu.gyro_arw * self.effects.gyro_noise,
            accel_vrw=imu.accel_vrw * self.effects.accel_noise,
            effects=self.effects.draw(np.random.default_rng([self.seed, 3])),
        )
        random = np.random.default_rng(table_seed)
        direction = random.standard_normal(3)
        mount = direction / np.linalg.norm(direction) * random.uniform(*_radians(self.mount_deg))
        heading = random.uniform(0.0, 2.0 * np.pi)
        phases = random.uniform(0.0, 2.0 * np.pi, 4)
        azimuth, base_tilt = radians(self.azimuth_deg), radians(self.base_tilt_deg)
        wobble = self.wobble_arcsec * _ARCSECOND
        offset = self.axis_offset_mm if isinstance(self.axis_offset_mm, tuple) else (self.axis_offset_mm, 0.0)
        table = TableTruth(
            latitude=radians(self.latitude_deg),
            height=self.height_m,
            azimuth=azimuth + radians(self.azimuth_error_deg) * float(random.standard_normal()),
            base_tilt=(base_tilt * float(np.cos(heading)), base_tilt * float(np.sin(heading)), 0.0),
            outer_axis=self.outer_axis,
            inner_axis=self.inner_axis,
            non_orthogonality=self.non_orthogonality_arcsec * _ARCSECOND * float(random.choice([-1.0, 1.0])),
            wobble=(wobble, wobble),
            wobble_phase=(float(phases[0]), float(phases[1])),
            axis_offset=(1e-3 * offset[0], 1e-3 * offset[1]),
            mount=(float(mount[0]), float(mount[1]), float(mount[2])),
            orientation=self.orientation,
            velocity_sigma=self.velocity_sigma,
            motion=self.table_motion,
            gravity=self.gravity_mps2,
        )
        encoder = EncoderTruth(
            stop_sigma=radians(self.encoder_sigma_deg),
            periodic=radians(self.encoder_periodic_deg),
            phase=(float(phases[2]), float(phases[3])),
            white_sigma=radians(self.encoder_noise_deg),
        )
        return BenchTruth(imu, table, encoder, self.grade, azimuth, self.outer_lever)

    def unit_thermal(self) -> UnitThermal | None:
        """Return the temperatures of the unit in the chamber; None without a chamber."""
        if self.chamber is None:
            return None
        return UnitThermal(
            self.thermal, GRADES[self.grade].sigma, self.chamber.room_c, np.random.default_rng([self.seed, 4])
        )

    def rig(self) -> ManualRig:
        """Return the manual rig at this site."""
        return ManualRig(
            latitude=radians(self.latitude_deg),
            height=self.height_m,
            gravity=self.gravity_mps2,
            outer_axis=self.outer_axis,
            inner_axis=self.inner_axis,
            velocity_sigma=self.velocity_sigma,
        )

    def gimbal(self, imu: ImuTruth, seed: np.random.SeedSequence) -> GimbalStream:
        """Return the gimbal at this site with its unit."""
        gravity = normal_gravity(radians(self.latitude_deg), self.height_m)
        east, north, up = earth_rate_n(radians(self.latitude_deg)).tolist()
        return GimbalStream(
            imu,
            seed,
            order=self.joint_order,
            up_force=(0.0, 0.0, gravity if self.gravity_mps2 is None else self.gravity_mps2),
            earth=(east, north, up),
            encoder_sigma=radians(self.encoder_sigma_deg),
        )

    def limits(self) -> TableLimits:
        """Return the limits of the table's travel, rates and acceleration."""
        return TableLimits(
            low=_radians(self.low_deg),
            high=_radians(self.high_deg),
            rate=radians(self.rate_deg_s),
            acceleration=radians(self.acceleration_deg_s2),
            homing_rate=radians(self.homing_rate_deg_s),
        )


class BenchReport(BaseModel):
    """The final state of a bench at device time `time`, s, and the injected faults; see `report_file`."""

    model_config = ConfigDict(frozen=True)

    enabled: bool
    moving: bool
    fault: str
    executed: tuple[str, ...]
    samples: int
    time: float
    flash_cycles: int


def _radians(degrees: Pair) -> Pair:
    return radians(degrees[0]), radians(degrees[1])
