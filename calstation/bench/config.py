"""Configuration of a virtual bench: unit, site, table, transports, planned faults."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from calstation.bench.table import TableLimits
from calstation.bench.truth import ARCSECOND, BenchTruth, GradeName, ManualRig
from calstation.physics import INDEX
from calstation.schema import EntryError, near_miss

Vector = tuple[float, float, float]
Pair = tuple[float, float]
NonNegative = Annotated[float, Field(ge=0.0)]
Positive = Annotated[float, Field(gt=0.0)]


def _known(name: str) -> str:
    if name not in INDEX:
        raise EntryError("entry.unknown_parameter", name=name, remedy=near_miss(name, INDEX))
    return name


ParameterName = Annotated[str, AfterValidator(_known)]

OrderName = Literal[
    "interlock",
    "drive_fault",
    "limit_fault",
    "stall",
    "trip_watchdog",
    "jam",
    "overshoot",
    "never_settle",
    "corrupt_frames",
    "drop_frames",
    "duplicate_frames",
    "reorder_frames",
    "noise_bytes",
    "silence_imu",
    "garble_imu",
    "saturate_imu",
    "invalid_imu",
    "freeze_channel",
    "jump_counter",
    "reset_imu",
    "hang_up_imu",
    "slow_imu",
    "mute_table",
    "slow_table",
    "garble_table",
    "refuse_table",
    "brown_out_write",
    "brown_out_commit",
]


class Order(BaseModel):
    """An ordered fault.

    order : of the table interlock (value 1 closed, 0 open), drive_fault, limit_fault, stall, trip_watchdog (each trips
        and latches), jam (its joints stand still and it says nothing), overshoot (degrees that the next move goes too
        far), never_settle (s);
        of the stream corrupt_frames (so many get a flipped bit), drop_frames, duplicate_frames, reorder_frames (each
        changes places with the next), noise_bytes (frames that get noise before them), silence_imu (s),
        garble_imu (s as at a wrong baud), saturate_imu (s), invalid_imu (s without a number from one channel: NaN, the
        lowest number where frames hold whole ones), freeze_channel (its number, 0 to 5), jump_counter (what it
        counts next), reset_imu;
        of the links hang_up_imu, mute_table (requests without an answer), slow_imu and slow_table (host seconds that
        an answer takes; ordered again, the one behind it), garble_table (answers with a flipped bit), refuse_table
        (the Modbus exception of the next answer);
        of the supply brown_out_write, brown_out_commit (bytes of registers taken, or of flash burnt, before the unit's
        power breaks down for a moment)
    at : device time, s
    after : device time from when the order is given, s
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    order: OrderName
    value: float = 1.0
    at: float = 0.0
    after: NonNegative = 0.0


class BenchConfig(BaseModel):
    """Configuration of a bench, with angles in degrees as in station files.

    Attributes
    ----------
    grade, seed : of the unit; the seed draws table, mount and noise as well
    parameters : of the unit by name, SI, in place of those drawn
    serial, table_serial : what unit and table answer
    speed : multiple of host time, 0 where time moves by the clock's `advance` alone
    sample_rate_hz, output, outer_lever, instability, out_of_limits : see `grades.draw_imu`
    gravity_mps2 : true gravity, None for the normal gravity of the place
    mount_deg : smallest and largest angle of the unit on its platform
    start_deg : joint angles at power-on, None draws them
    imu_protocol : what the unit's commands are
    behind_registers : the unit's stream always has its registers applied (framed, modbus)
    table_protocol : what the table speaks: "drives" where each axis is a Modbus unit of its own; "imu_link" where
        the unit's own line carries its registers; "hand" where the unit sits on rails that hands turn
    table_transport : over TCP or, "rtu", over a pseudo-terminal
    latency_s, jitter_s : a polled angle is this old, uniformly ± the jitter
    clock_drift_ppm : device time gains this much on the clock service's
    ready_time_s : from power-up to the unit's ready bit
    ambient_c, warm_up_c, warm_up_time_s : temperature and its exponential rise
    watchdog_ms : the table's timeout at power-on, host time
    flash_file : keeps the unit's flash over runs; flash_banks : 2, or 1 for a unit that has no spare
    orders : faults to come
    report_file : where the bench writes at its end how it was left and which orders it has obeyed; it then lives until
        its watchdog has had its time
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    grade: GradeName = "nav"
    seed: Annotated[int, Field(ge=0)] = 1
    parameters: dict[ParameterName, float] = Field(default_factory=dict)
    serial: str = "SN-000001"
    table_serial: str = "T-0001"
    speed: NonNegative = 0.0
    sample_rate_hz: Positive = 200.0
    output: Literal["increment", "rate"] = "increment"
    outer_lever: Literal["estimated", "fixed"] = "estimated"
    instability: bool = True
    out_of_limits: bool = False

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
    encoder_sigma_deg: NonNegative = 0.05
    encoder_periodic_deg: NonNegative = 0.005
    encoder_noise_deg: NonNegative = 0.0005
    velocity_sigma: NonNegative = 1e-3
    start_deg: Pair | None = None
    low_deg: Pair = (-1080.0, -1080.0)
    high_deg: Pair = (1080.0, 1080.0)
    rate_deg_s: Positive = 120.0
    acceleration_deg_s2: Positive = 200.0
    homing_rate_deg_s: Positive = 5.0
    interlock_closed: bool = True
    watchdog_ms: Annotated[int, Field(ge=0, le=65535)] = 2000

    table_protocol: Literal["modbus", "drives", "imu_link", "atl", "acl", "mn", "hand"] = "modbus"
    table_transport: Literal["tcp", "rtu"] = "tcp"
    imu_protocol: Literal["framed", "modbus", "vectornav"] = "framed"
    imu_transport: Literal["socket", "pty"] = "socket"
    behind_registers: bool = False
    latency_s: NonNegative = 0.002
    jitter_s: NonNegative = 0.001
    clock_drift_ppm: float = 20.0
    ready_time_s: NonNegative = 1.0
    ambient_c: float = 23.0
    warm_up_c: float = 4.0
    warm_up_time_s: Positive = 30.0
    flash_file: Path | None = None
    flash_banks: Literal[1, 2] = 2
    orders: tuple[Order, ...] = ()
    report_file: Path | None = None

    def truth(self) -> BenchTruth:
        """The bench that this configuration and its seed draw."""
        drawn = BenchTruth.draw(
            self.grade,
            self.seed,
            latitude=np.deg2rad(self.latitude_deg),
            height=self.height_m,
            azimuth=np.deg2rad(self.azimuth_deg),
            gravity=self.gravity_mps2,
            outer_axis=self.outer_axis,
            inner_axis=self.inner_axis,
            sample_rate=self.sample_rate_hz,
            output=self.output,
            outer_lever=self.outer_lever,
            mount=(np.deg2rad(self.mount_deg[0]), np.deg2rad(self.mount_deg[1])),
            azimuth_error=np.deg2rad(self.azimuth_error_deg),
            base_tilt=np.deg2rad(self.base_tilt_deg),
            non_orthogonality=self.non_orthogonality_arcsec * ARCSECOND,
            wobble=self.wobble_arcsec * ARCSECOND,
            encoder_sigma=np.deg2rad(self.encoder_sigma_deg),
            encoder_periodic=np.deg2rad(self.encoder_periodic_deg),
            encoder_noise=np.deg2rad(self.encoder_noise_deg),
            velocity_sigma=self.velocity_sigma,
            instability=self.instability,
            out_of_limits=self.out_of_limits,
        )
        parameters = drawn.parameters.copy()
        for name, value in self.parameters.items():
            parameters[INDEX[name]] = value
        return replace(drawn, imu=replace(drawn.imu, parameters=parameters))

    def rig(self) -> ManualRig:
        """The manual rig at this site."""
        return ManualRig(
            latitude=np.deg2rad(self.latitude_deg),
            height=self.height_m,
            gravity=self.gravity_mps2,
            outer_axis=self.outer_axis,
            inner_axis=self.inner_axis,
            velocity_sigma=self.velocity_sigma,
        )

    def limits(self) -> TableLimits:
        """Travel and speeds of the table."""
        return TableLimits(
            low=(np.deg2rad(self.low_deg[0]), np.deg2rad(self.low_deg[1])),
            high=(np.deg2rad(self.high_deg[0]), np.deg2rad(self.high_deg[1])),
            rate=np.deg2rad(self.rate_deg_s),
            acceleration=np.deg2rad(self.acceleration_deg_s2),
            homing_rate=np.deg2rad(self.homing_rate_deg_s),
        )
