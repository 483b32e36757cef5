"""The tasks of a run and its units, which are built from the configuration of the run."""

from dataclasses import replace
from functools import partial

import numpy as np
from pydantic import BaseModel

from calstation.config import RunConfiguration, temperature_ranges
from calstation.devices.profiles import channel_range
from calstation.estimation import RepeatedSchedule
from calstation.estimation.common import BIAS_SIGMAS, REST_RATE
from calstation.physics import GimbalTurn, group_indices
from calstation.records import LogMeta, context_from_meta, prior_from_meta
from calstation.sequencer.chamber import ChamberLimits
from calstation.sequencer.context import Output, PreflightLimits, Task, UnitTask
from calstation.sequencer.plan import StagePlan, StopRule


def table_task(setup: RunConfiguration) -> Task:
    """Return the motion of the table in a run."""
    load = setup.product.load_angle
    gimbal_stages = setup.stages if setup.table.gimbal is not None else ()
    gimbal_steps = (step for stage in gimbal_stages for step in setup.plan(stage))
    return Task(
        stages=tuple(
            StagePlan(stage, partial(setup.plan, stage), _stop_rule(schedule))
            for stage, schedule in setup.schedules.items()
        ),
        geometry=setup.table.geometry(),
        by_hand=setup.table.by_hand,
        latency=setup.table.accuracy.poll_latency_s,
        settle=setup.table.settle_s,
        load_angle=(float(np.deg2rad(load.outer_deg)), float(np.deg2rad(load.inner_deg))),
        gimbal_turn=next((step for step in gimbal_steps if isinstance(step, GimbalTurn)), None),
    )


def chamber_limits(*setups: RunConfiguration) -> ChamberLimits | None:
    """Return the limits of the station's chamber with the table and these units in it; None without a chamber.

    Raises ConfigurationError if the profile of the table or a unit has no temperature range.
    """
    first = setups[0]
    section, profile = first.station.chamber, first.chamber
    if section is None or profile is None:
        return None
    inside = [temperature_ranges(setup) for setup in setups]
    units = [ranges["unit"] for ranges in inside]
    return ChamberLimits(
        ranges={
            "chamber": profile.range_c,
            "table": inside[0]["table"],
            "unit": (max(low for low, _ in units), min(high for _, high in units)),
        },
        max_rate=profile.max_rate,
        ambient=section.ambient_c,
        dew_point=section.dew_point,
        agreement=section.agreement_c,
        follow_time=profile.follow_s,
    )


def unit_task(setup: RunConfiguration, meta: LogMeta | None = None) -> UnitTask:
    """Return the task of a unit; `meta` is the configuration of its log, by default one without registers."""
    meta = meta or setup.log_meta()
    context = context_from_meta(meta)
    prior, biases = prior_from_meta(meta), group_indices("gyro_bias")
    spread = BIAS_SIGMAS * prior.sigma[biases] + REST_RATE
    warm_up = setup.product.warm_up
    return UnitTask(
        serial=setup.request.serial,
        model=context.imu,
        preflight=PreflightLimits(
            serial_pattern=setup.product.serial_pattern,
            gravity=context.site.local_gravity,
            rate_low=prior.mean[biases] - spread,
            rate_high=prior.mean[biases] + spread,
            warm_up=warm_up.time_s,
            warm_up_slope=warm_up.slope_c_per_min,
            warm_up_timeout=warm_up.timeout_s,
        ),
        geometry=replace(setup.table.geometry(), orientation=context.table.orientation),
        masks=setup.imu.status,
        span=channel_range(setup.imu.frame),
        wrap=setup.imu.frame.counter_period,
        corrected=corrected_output(setup),
    )


def corrected_output(setup: RunConfiguration) -> Output:
    """Return when a unit applies its registers to its output."""
    if setup.after_registers:
        return Output.ALWAYS
    return Output.NEVER if setup.imu.corrected is None else Output.ON_COMMAND


def _stop_rule(schedule: BaseModel) -> StopRule:
    """Return the stop rule of a schedule, without conditions if the plan is not repeated."""
    if not isinstance(schedule, RepeatedSchedule):
        temperatures = getattr(schedule, "points_c", [])
        return StopRule(rounds=len(temperatures) or None, repeated=bool(temperatures))
    return StopRule(
        rounds=schedule.rounds or None,
        duration=schedule.duration_s,
        targets=schedule.targets,
        usual=getattr(schedule, "least_moves", None) if schedule.targets else None,
        repeated=True,
    )
