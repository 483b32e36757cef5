"""What the window draws of a gimbal's answer: how each axis' drift shrank, and its gain in the stable range."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from calstation.estimation.gimbal.iteration import AXES, contraction
from calstation.physics.arrays import FloatArray


@dataclass(frozen=True)
class GimbalAxis:
    """One axis' turns.

    Attributes
    ----------
    drift : larger drift of the other two joints in each turn, rad, shape (turns,)
    predicted : what the gain promises to be left of the first, rad, shape (turns,)
    gain, largest, best : in use, the one up to which turns converge, and the one that converges fastest, rad/rad
    contraction, best_contraction : what a turn leaves of the error at `gain` and at `best`
    done : the last drift lies below the threshold
    """

    axis: str
    angle: float
    drift: FloatArray
    predicted: FloatArray
    gain: float
    largest: float
    best: float
    contraction: float
    best_contraction: float
    done: bool


@dataclass(frozen=True)
class GimbalPlotData:
    """All axes in the order in which they were turned; threshold : of a drift, rad.

    least_squares : value and sigma of each misalignment from all samples at once, rad
    """

    axes: tuple[GimbalAxis, ...]
    threshold: float
    least_squares: Mapping[str, tuple[float, float]]


def gimbal_plot_data(details: Mapping[str, Any], schedule: Mapping[str, Any]) -> GimbalPlotData:
    """From the stage's details and the schedule in force."""
    threshold = float(np.deg2rad(schedule["threshold_arcsec"] / 3600.0))
    order = str(schedule["order"])
    return GimbalPlotData(
        tuple(_axis(told, order, threshold) for told in details["axes"]),
        threshold,
        {name: (row["value"], row["sigma"]) for name, row in details["least_squares"].items()},
    )


def _axis(told: Mapping[str, Any], order: str, threshold: float) -> GimbalAxis:
    axis, angle = AXES.index(told["axis"]), float(np.mean(np.abs(told["angles"])))
    drift = np.abs(np.array(told["drifts"])).max(axis=1)
    largest, left = float(told["largest_gain"]), float(told["contraction"])
    best = _best_gain(order, axis, angle, largest)
    return GimbalAxis(
        axis=told["axis"],
        angle=angle,
        drift=drift,
        predicted=drift[0] * left ** np.arange(len(drift)),
        gain=float(told["gain"]),
        largest=largest,
        best=best,
        contraction=left,
        best_contraction=contraction(order, axis, angle, best),
        done=bool(drift[-1] < threshold),
    )


def _best_gain(order: str, axis: int, angle: float, largest: float) -> float:
    """The gain with the smallest contraction; 0 where no gain converges."""
    if largest <= 0.0:
        return 0.0
    from scipy.optimize import minimize_scalar  # takes long to import, and few answers need it

    found = minimize_scalar(
        lambda gain: contraction(order, axis, angle, gain), bounds=(0.0, largest), method="bounded"
    )
    return float(found.x)
