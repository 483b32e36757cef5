"""Plot data of a gimbal calibration: convergence of each axis' drift, and its gain within the stable range."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from calstation.estimation.gimbal import AXES, contraction
from calstation.physics import FloatArray


@dataclass(frozen=True)
class GimbalAxis:
    """Turns of one axis."""

    axis: str
    angle: float
    drift: FloatArray  #: Larger drift of the other two joints in each turn, rad, shape (turns,).
    predicted: FloatArray  #: Drift predicted from the first one and the gain, rad, shape (turns,).
    gain: float  #: Used, rad/rad.
    largest: float  #: Largest convergent gain, rad/rad.
    best: float  #: Fastest convergent gain, rad/rad.
    contraction: float  #: Remaining share of the error per turn at `gain`.
    best_contraction: float  #: Remaining share of the error per turn at `best`.
    done: bool  #: The last drift is below the threshold.


@dataclass(frozen=True)
class GimbalPlotData:
    """All axes in the order of their turns."""

    axes: tuple[GimbalAxis, ...]
    threshold: float  #: Of the drift, rad.
    #: Value and sigma of each misalignment from all samples at once, rad.
    least_squares: Mapping[str, tuple[float, float]]


def gimbal_plot_data(details: Mapping[str, Any], schedule: Mapping[str, Any]) -> GimbalPlotData:
    """Compute the plot data from the stage's details and schedule."""
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
    """The gain with the smallest contraction, or 0 without a convergent one."""
    if largest <= 0.0:
        return 0.0
    from scipy.optimize import minimize_scalar  # slow to import and rarely needed

    found = minimize_scalar(lambda gain: contraction(order, axis, angle, gain), bounds=(0.0, largest), method="bounded")
    return float(found.x)
