"""Simulated recordings without a rate table: a manual rig, several IMUs on one body, a gimbal.

Each recording has the format of a station's raw log, and its true parameters are known.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from calstation.bench.truth import (
    GRADES,
    GimbalBench,
    GimbalSamples,
    ImuTruth,
    ManualRig,
    Mounting,
    SecondaryTruth,
    around,
    draw_imu,
    pair_truth,
    push,
    record,
    record_pair,
    rotation,
)
from calstation.bench.truth import GradeName as GradeName
from calstation.config import site_folder
from calstation.errors import ConfigurationError
from calstation.estimation.common import ImuModel, SampleBlock, snap_angles
from calstation.estimation.gimbal import BIAS_TIME, GimbalIteration, joint_turn
from calstation.jobs import ProgressCallback
from calstation.messages import os_reason
from calstation.physics import AXES, NAMES, PARAMETERS, FloatArray, group_indices, pair_name
from calstation.records import LogFacts, LogMeta, RawLogWriter, context_from_meta, truth_path, write_atomic
from procedures import method

Kind = Literal["hand", "pair", "gimbal"]
SAMPLE_RATE = 100.0
_LATITUDE_DEG, _HEIGHT = 34.25, 400.0
_AT_REST = {"gyro": {"fixed": 2e-4}, "accel": {"fixed": 5e-3}}
#: Schedule with a short motion; the limits at rest allow for an uncalibrated MEMS unit and earth rate, 0.7e-4 rad/s.
_PAIR_SCHEDULE = {
    "motion_s": 10.0,
    **{f"{unit}_{sensor}": limit for unit in ("primary", "secondary") for sensor, limit in _AT_REST.items()},
}
_RIG = ManualRig(latitude=float(np.deg2rad(_LATITUDE_DEG)), height=_HEIGHT)


def make_recording(kind: Kind, path: Path, grade: GradeName = "mems", seed: int = 1) -> tuple[LogFacts, dict[str, Any]]:
    """Write a recording as a raw log; return the summary of the log and the true values by parameter, SI.

    Raises ConfigurationError if the log cannot be created.

    Parameters
    ----------
    kind : kind of recording
    path : file to write
    grade : grade of the units
    seed : seed of the units and their motion
    """
    makers = {"hand": _manual_rig, "pair": _pair, "gimbal": _gimbal}
    return makers[kind](path, grade, seed)


def recordings_folder() -> Path:
    """Return the folder in which the window saves recordings of the virtual bench."""
    return site_folder() / "recordings"


def record_on_bench(progress: ProgressCallback, kind: str, path: Path, grade: str, seed: int) -> Path:
    """Job: write a recording and the file with its true parameters, replacing existing files.

    Raises ConfigurationError if the file cannot be written.
    """
    progress(0.0)
    partial = path.with_name(f".{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.unlink(missing_ok=True)
        _, truth = make_recording(cast(Kind, kind), partial, cast(GradeName, grade), seed)
        progress(0.9)
        write_atomic(truth_path(path), json.dumps(truth, indent=1) + "\n")
        partial.replace(path)
    except OSError as exc:
        raise ConfigurationError("csv.not_written", file=path, reason=os_reason(exc)) from exc
    return path


def _unit(grade: GradeName, seed: int, *, plain: bool = False) -> ImuTruth:
    """Draw a unit; `plain` omits the second-order terms and lever arms, which a pair cannot determine."""
    imu = draw_imu(grade, np.random.default_rng(seed), sample_rate=SAMPLE_RATE)
    if plain:
        parameters = imu.parameters.copy()
        for group in ("accel_quadratic", "inner_lever", "outer_lever"):
            parameters[group_indices(group)] = 0.0
        imu = replace(imu, parameters=parameters)
    return imu


def _imu_section(imu: ImuTruth, serial: str) -> dict[str, Any]:
    same = ("gyro_lsb", "accel_lsb", "gyro_arw", "accel_vrw", "gyro_bias_instability", "accel_bias_instability")
    numbers = {name: float(getattr(imu, name)) for name in same}
    return {"serial": serial, "output": imu.output, "sample_rate_hz": float(imu.sample_rate), **numbers}


def _meta(imu: ImuTruth, grade: GradeName, serial: str, **more: Any) -> LogMeta:
    sigma = {p.name: {"sigma": float(2.0 * GRADES[grade].sigma[p.group])} for p in PARAMETERS}
    site = {"latitude_deg": _LATITUDE_DEG, "longitude_deg": 108.9, "height_m": _HEIGHT}
    return LogMeta.model_validate(
        {"site": site, "imu": _imu_section(imu, serial), "prior": sigma, "simulated": True, **more}
    )


def _truth(imu: ImuTruth) -> dict[str, float]:
    return dict(zip(NAMES, imu.parameters.tolist(), strict=True))


def _write(path: Path, meta: LogMeta, block: SampleBlock) -> LogFacts:
    writer = RawLogWriter(path, meta)
    writer.append(block)
    return writer.close("recorded")


def _manual_rig(path: Path, grade: GradeName, seed: int) -> tuple[LogFacts, dict[str, Any]]:
    imu = _unit(grade, seed)
    samples, _ = record(imu, _RIG, around(), seed)
    block = SampleBlock.without_table("multi_position", np.arange(len(samples.time)), samples.time, samples.counts)
    return _write(path, _meta(imu, grade, f"BENCH-{grade}-{seed}"), block), _truth(imu)


def _pair(path: Path, grade: GradeName, seed: int) -> tuple[LogFacts, dict[str, Any]]:
    random = np.random.default_rng([seed, 1])
    primary = _unit(grade, 2 * seed, plain=True)
    mounting = Mounting(rotation(0.03 * random.standard_normal(3)), random.uniform(-0.1, 0.1, 3))
    secondary = SecondaryTruth(_unit(grade, 2 * seed + 1, plain=True), mounting, float(random.uniform(-0.02, 0.02)))
    rig = replace(_RIG, initial_rest=6.0, rest=2.0, speed=float(np.deg2rad(120.0)))
    motion, duration = push(rig, around(np.deg2rad(60.0)), random)
    counts, others = record_pair(primary, [secondary], motion, duration, rig.field, seed)
    meta = _meta(
        primary,
        grade,
        f"BENCH-{grade}-{seed}A",
        imu2=_imu_section(secondary.imu, f"BENCH-{grade}-{seed}B"),
        # the primary was calibrated before, so its own errors are known
        prior={name: {"value": value, "sigma": 1e-9} for name, value in _truth(primary).items()},
        schedule={"cross_calibration": _PAIR_SCHEDULE},
    )
    time = np.arange(1, len(counts) + 1) / SAMPLE_RATE
    block = SampleBlock.without_table("cross_calibration", np.arange(len(time)), time, counts, others=others)
    return _write(path, meta, block), _pair_truth(pair_truth(primary, secondary))


def _pair_truth(truth: dict[str, FloatArray]) -> dict[str, float]:
    values = {pair_name("clock_offset", 2): float(truth["clock_offset"])}
    for i, a in enumerate(AXES):
        values[f"secondary_lever_{a}"] = float(truth["lever"][i])
        for sensor in ("gyro", "accel"):
            values[f"secondary_{sensor}_bias_{a}"] = float(truth[f"{sensor}_bias"][i])
            for j, b in enumerate(AXES):
                values[f"secondary_{sensor}_matrix_{a}{b}"] = float(truth[f"{sensor}_matrix"][i, j])
    return values


def run_gimbal(
    bench: GimbalBench, schedule: Any, imu: ImuModel, store: Callable[[SampleBlock], None]
) -> GimbalIteration:
    """Run the gimbal method in closed loop on the simulated gimbal; return the iteration.

    Raises InputError if a turn is not detected in the joint angles.

    Parameters
    ----------
    bench : simulated gimbal
    schedule : schedule of the method `gimbal`
    imu : profile of the unit
    store : function that is called with the samples of each motion and rest
    """
    iteration: GimbalIteration = schedule.iteration()
    dwell = schedule.dwell_s
    rate = float(np.deg2rad(schedule.rate_dps))
    blocks: list[SampleBlock] = []

    def take(samples: GimbalSamples) -> None:
        columns = {"step": samples.step, "joints": snap_angles(samples.joints)}
        blocks.append(SampleBlock.without_table("gimbal", samples.seq, samples.time, samples.counts, **columns))
        store(blocks[-1])

    locked = bench.lock(dwell + BIAS_TIME)
    bench.zero_bias(locked)
    take(locked)
    take(bench.hold(dwell, iteration.correction))
    while (turn := iteration.next_turn()) is not None:
        if turn.home:
            take(bench.home(rate))
            take(bench.hold(dwell, turn.correction))
            iteration.at_zero()
        begin = int(blocks[-1].seq[-1])
        take(bench.turn(turn.axis, turn.angle, rate, turn.correction))
        take(bench.hold(dwell, turn.correction))
        motion = joint_turn(blocks, imu, begin, turn.axis)
        iteration.add_drift(turn.axis, turn.angle, motion.joint_drift(turn.axis, schedule.order))
    take(bench.home(rate))
    take(bench.hold(dwell, iteration.correction))
    return iteration


def _gimbal(path: Path, grade: GradeName, seed: int) -> tuple[LogFacts, dict[str, Any]]:
    imu, encoder_deg = _unit(grade, seed), 0.002
    schedule: Any = method("gimbal").schedule()
    meta = _meta(
        imu,
        grade,
        f"BENCH-{grade}-{seed}",
        table={"encoder_sigma_deg": encoder_deg},
        schedule={"gimbal": schedule.model_dump(mode="json")},
    )
    bench = GimbalBench(
        imu,
        seed,
        order=schedule.order,
        up_force=(0.0, 0.0, float(_RIG.field.up_force[2])),
        encoder_sigma=float(np.deg2rad(encoder_deg)),
    )
    writer = RawLogWriter(path, meta, joints=True)
    run_gimbal(bench, schedule, context_from_meta(meta).imu, writer.append)
    return writer.close("recorded"), _truth(imu)
