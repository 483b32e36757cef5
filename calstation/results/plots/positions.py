"""Plot data of a multi-position calibration: direction of gravity, and residuals at every rest and motion."""

from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import SolveContext, StageData
from calstation.estimation.positions import gather, gravity_misses
from calstation.physics import FloatArray, normal_gravity
from calstation.records import ProductSection


@dataclass(frozen=True)
class PositionPlotData:
    """Rests and motions of a recording, with the parameters before and after the calibration."""

    gravity: float
    up: FloatArray  #: Direction of gravity's reaction in b at each rest, unit vectors, shape (n, 3).
    rest_time: FloatArray  #: Start of each rest since the recording's start, s, shape (n,).
    rest_length: FloatArray  #: Duration of each rest, s, shape (n,).
    force_before: FloatArray  #: Magnitude of the force at each rest minus gravity, m/s², shape (n,).
    force_after: FloatArray  #: Magnitude of the force at each rest minus gravity, m/s², shape (n,).
    motion_time: FloatArray  #: Since the recording's start, s, shape (m,).
    angle_before: FloatArray  #: Between gravity after each motion and its propagation by the gyros, rad, shape (m,).
    angle_after: FloatArray  #: Between gravity after each motion and its propagation by the gyros, rad, shape (m,).
    force_limit: float | None  #: Of the product's checks, m/s².
    angle_limit: float | None  #: Of the product's checks, rad.


def position_plot_data(
    data: StageData,
    context: SolveContext,
    before: FloatArray,
    found: FloatArray,
    product: ProductSection | None,
) -> PositionPlotData:
    """Compute the plot data from the parameters before and after (SI, shape (30,)), with the limits of the product."""
    site = context.site
    gravity = site.gravity or normal_gravity(site.latitude, site.height)
    evidence = gather("multi_position", data, context, before, found)
    rests, motions = evidence.rests, evidence.motions
    lengths = [[float(np.linalg.norm(rest.compensated(p)[1])) - gravity for rest in rests] for p in (before, found)]
    angles = np.array([gravity_misses(evidence, motion, found) for motion in motions]).reshape(-1, 2)
    force = np.array([rest.compensated(found)[1] for rest in rests]).reshape(-1, 3)
    checks = product.checks if product is not None else None
    force_check, angle_check = (checks.gravity_at_rest, checks.motion_angle) if checks is not None else (None, None)
    start = int(data.seq[0])
    return PositionPlotData(
        gravity=gravity,
        up=force / np.linalg.norm(force, axis=1, keepdims=True),
        rest_time=np.array([(r.first_seq - start) * data.dt for r in rests]),
        rest_length=np.array([r.duration for r in rests]),
        force_before=np.array(lengths[0]),
        force_after=np.array(lengths[1]),
        motion_time=np.array([(m.first_seq - start) * data.dt for m in motions]),
        angle_before=angles[:, 0],
        angle_after=angles[:, 1],
        force_limit=None if force_check is None else force_check.within,
        angle_limit=None if angle_check is None else angle_check.within,
    )
