"""Multi-position: joint calibration of gyros and accelerometers on a simple or manual rig without accurate angles.

Rests and motions are detected in the data. Rotations about a horizontal axis are observable from gravity; the plan
contains such rotations about every body axis.
"""

from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from calstation.errors import ConfigurationError, InputError
from calstation.estimation import BatchStage, Method, Solution
from calstation.estimation.common import (
    REST_MARGIN,
    Link,
    Posterior,
    SolveContext,
    StageData,
    Stillness,
    consider_update,
    find_stillness,
    nis_consistency,
)
from calstation.estimation.positions import (
    MAX_ITERATIONS,
    Position,
    PositionFit,
    Scatter,
    fit_positions,
    positions,
    valid_links,
)
from calstation.messages import Text
from calstation.physics import (
    DEGREE,
    DEGREE_PER_HOUR,
    INNER,
    JOINTS,
    MICRO_G,
    NAMES,
    OUTER,
    PARAMETERS,
    Dwell,
    ManualMove,
    Move,
    Step,
    TableGeometry,
)

GROUPS = ("gyro_bias", "gyro_scale", "gyro_misalign", "accel_bias", "accel_scale", "accel_misalign")
ESTIMATED = tuple(p.name for p in PARAMETERS if p.group in GROUPS)
#: Prefixes of the names of the parameters whose sigmas depend on a kind of scatter.
_DEPENDENT_PREFIXES = {"force": ("accel",), "turn": ("gyro_scale", "gyro_misalign")}
#: Largest scatter of the angles of turns in a usable recording, rad; also the largest that a schedule may assume.
MAX_TURN_SCATTER = float(np.deg2rad(10.0))
#: Outer and inner joint angle, rad.
Pose = tuple[float, float]
#: Time in which an operator reads an instruction and releases an axis, s.
READING_TIME = 3.0


class Schedule(BaseModel):
    """Durations of rests (s), angles (°), and rate and acceleration of moves (°/s, °/s²)."""

    model_config = ConfigDict(extra="forbid")
    initial_rest_s: float = Field(30.0, ge=2.0, le=3600.0)  #: Level rest before the first motion.
    rest_s: float = Field(8.0, ge=2.0, le=600.0)  #: Rest at each position.
    step_deg: float = Field(45.0, ge=15.0, le=120.0)  #: Angle between positions.
    rate_dps: float = Field(20.0, gt=0.0, le=360.0)
    acceleration_dps2: float = Field(20.0, gt=0.0, le=1000.0)
    manual: bool = False  #: Whether an operator turns the axes at about `rate_dps`, guided by the program.
    shortest_rest_s: float = Field(1.0, ge=0.5, le=60.0)  #: Shortest rest at a position; a shorter one is a pause.
    #: Scatter of the force at a rest, m/s², and of the angle of a turn, which are assumed for a recording without
    #: redundancy. The defaults are for a unit that is turned by hand.
    force_scatter: float = Field(0.01, ge=0.0, le=1.0)
    turn_scatter_deg: float = Field(0.3, ge=0.0, le=10.0)


def plan(geometry: TableGeometry, schedule: Schedule) -> Iterator[Step]:
    """Plan revolutions to and fro of the inner joint, of the outer joint, and of the outer joint with the inner at 90°.

    Raises ConfigurationError if the travel permits only the first position.
    """
    poses = _poses(geometry, schedule)
    if schedule.manual:
        yield from _manual_steps(schedule, list(poses))
        return
    rate, acceleration = np.deg2rad(schedule.rate_dps), np.deg2rad(schedule.acceleration_dps2)
    yield Move(0.0, 0.0, rate, acceleration, ("start",))
    yield Dwell(schedule.initial_rest_s)
    for pose in poses:
        yield Move(*pose, rate, acceleration, ("position", *(float(np.rad2deg(a)) for a in pose)))
        yield Dwell(schedule.rest_s)


def _poses(geometry: TableGeometry, schedule: Schedule) -> Iterator[Pose]:
    """Yield the joint angles, rad, of the positions after the first, which is (0, 0)."""
    level = geometry.level_inner((0.0, 0.0))
    for joint, other in ((INNER, level), (OUTER, 0.0), (OUTER, 0.5 * np.pi)):
        for angle in _around(geometry, joint, np.deg2rad(schedule.step_deg)):
            yield (angle, other) if joint == OUTER else (other, angle)


def _manual_steps(schedule: Schedule, poses: list[Pose]) -> Iterator[Step]:
    """Yield a step for each position; positions equal to the preceding one are omitted."""
    visited: list[Pose] = [(0.0, 0.0)]
    for pose in poses:
        if max(abs(a - b) for a, b in zip(pose, visited[-1], strict=True)) > 1e-6:
            visited.append(pose)
    for index, pose in enumerate(visited, start=1):
        before = visited[max(index - 2, 0)]
        distance = max(abs(a - b) for a, b in zip(pose, before, strict=True))
        travel_time = distance / float(np.deg2rad(schedule.rate_dps))
        rest = schedule.rest_s if index > 1 else schedule.initial_rest_s
        yield ManualMove(*pose, rest, travel_time + READING_TIME if index > 1 else 0.0, index, len(visited))


def _around(geometry: TableGeometry, joint: int, step: float) -> Iterator[float]:
    """Yield the joint angles, rad, of one revolution and back to 0, or to both ends of a shorter travel and back."""
    steps = round(2.0 * np.pi / step)
    for way in (1.0, -1.0):
        if geometry.limits.within(joint, way * steps * step):
            yield from (way * k * step for k in (*range(steps + 1), *range(steps - 1, -1, -1)))
            return
    low, high = geometry.limits.low[joint], geometry.limits.high[joint]
    up, down = int((high + 1e-9) // step), int((-low + 1e-9) // step)
    if up + down < 1:
        raise ConfigurationError("plan.positions_exceed_travel", step_deg=float(np.rad2deg(step)), axis=JOINTS[joint])
    yield from (k * step for k in (*range(up + 1), *range(up - 1, -down - 1, -1), *range(-down + 1, 1)))


def solve(data: StageData, context: SolveContext, prior: Posterior, schedule: Schedule) -> Solution:
    """Solve the stage from its rests and motions. Raises InputError if the recording cannot be used."""
    shortest = schedule.shortest_rest_s
    still = find_stillness(data, context.imu, shortest)
    links = valid_links(data, still, context.imu, context.site.local_gravity, prior, shortest)
    rests = positions(data, still, context)
    estimated = ESTIMATED if data.has_gyros else tuple(n for n in ESTIMATED if n.startswith("accel"))
    mask = np.array([name in estimated for name in NAMES])
    by_hand = not data.has_angles  # a table has no such scatter
    assumed = Scatter(by_hand * schedule.force_scatter, 0.0, by_hand * float(np.deg2rad(schedule.turn_scatter_deg)))
    fit = fit_positions(data, rests, links, context, prior, mask, assumed)
    if "turn" not in fit.assumed and fit.scatter.turn > MAX_TURN_SCATTER:
        scatter = float(np.rad2deg(fit.scatter.turn))
        raise InputError("recording.turns_scatter", scatter_deg=scatter, limit_deg=float(np.rad2deg(MAX_TURN_SCATTER)))
    return Solution(
        stage="multi_position",
        posterior=consider_update(prior, fit.posterior, mask),
        estimated=estimated,
        consistency=nis_consistency(fit.chi2, max(round(fit.freedom), 1), 1),
        gaps=data.gaps,
        details=_details(data, still, rests, links, fit),
        sensitivity=fit.sensitivity,
        assumed=tuple(name for name in estimated for kind in fit.assumed if name.startswith(_DEPENDENT_PREFIXES[kind])),
        messages=_messages(data, still, links, fit, shortest),
    )


def _details(
    data: StageData, still: Stillness, rests: list[Position], links: tuple[Link, ...], fit: PositionFit
) -> dict[str, Any]:
    return {
        "positions": [
            {
                **data.seq_range(r.start, r.stop),
                "force": r.force.tolist(),
                "up": C[2].tolist(),
                "residual": residual.tolist(),
            }
            for r, C, residual in zip(rests, fit.attitudes, fit.force_residual, strict=True)
        ],
        "motions": [
            {
                **data.seq_range(link.start, link.stop),
                "from": link.first,
                "to": link.second,
                "residual": residual.tolist(),
            }
            for link, residual in zip(links, fit.turn_residual, strict=True)
        ],
        "cuts": [int(data.seq[k]) for k in still.cuts],
        "scatter": {"force": fit.scatter.force, "rate": fit.scatter.rate, "turn": fit.scatter.turn},
        "noise": {"gyro_arw": still.gyro_noise, "accel_vrw": still.accel_noise},
    }


def _messages(
    data: StageData, still: Stillness, links: tuple[Link, ...], fit: PositionFit, shortest: float
) -> tuple[tuple[str, dict[str, Any]], ...]:
    stage = {"stage": "multi_position"}
    messages: list[tuple[str, dict[str, Any]]] = []
    if not fit.converged:
        messages.append(("not_converged", {**stage, "passes": MAX_ITERATIONS}))
    if still.cuts:
        messages.append(("recording_cut", {**stage, "count": len(still.cuts)}))
    if still.too_short:
        needed = shortest + 2.0 * REST_MARGIN
        messages.append(("short_rests_left_out", {**stage, "count": still.too_short, "needed": needed}))
    if len(links) < len(still.links):
        messages.append(("motions_left_out", {**stage, "count": len(still.links) - len(links)}))
    if not data.has_gyros:
        messages.append(("accelerometers_alone", stage))
    elif not links:
        messages.append(("no_motion_between_rests", stage))
    if fit.assumed:
        messages.append(("scatter_assumed", {**stage, "scatter": _scatter_texts(fit.scatter, fit.assumed)}))
    measured = [kind for kind in ("force", "rate", "turn") if kind not in fit.assumed and getattr(fit.scatter, kind)]
    if measured:
        messages.append(("noisier_than_profile", {**stage, "scatter": _scatter_texts(fit.scatter, measured)}))
    return tuple(messages)


def _scatter_texts(scatter: Scatter, kinds: Iterable[str]) -> list[Text]:
    """Return the size of each kind of scatter in the units that people use."""
    sizes = {"force": MICRO_G, "rate": DEGREE_PER_HOUR, "turn": DEGREE}
    return [Text.of(f"recording.scatter_{kind}", size=getattr(scatter, kind) / sizes[kind]) for kind in kinds]


METHOD = Method(
    "multi_position",
    Schedule,
    plan,
    partial(BatchStage, solve),
    estimates=lambda context: ESTIMATED,
    needs_no_table=True,
    without_gyros=True,
)
