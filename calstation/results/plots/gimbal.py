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
    best: float  #: Fastest convergent gain, rad/rad; 0 without one.
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
    return GimbalPlotData(
        tuple(_axis(row, str(schedule["order"]), threshold) for row in details["axes"]),
        threshold,
        {name: (row["value"], row["sigma"]) for name, row in details["least_squares"].items()},
    )


def _axis(row: Mapping[str, Any], order: str, threshold: float) -> GimbalAxis:
    axis, angle = AXES.index(row["axis"]), float(np.mean(np.abs(row["angles"])))
    drift = np.abs(np.array(row["drifts"])).max(axis=1)
    largest, remaining = float(row["largest_gain"]), float(row["contraction"])
    best = 0.0
    if largest > 0.0:
        from scipy.optimize import minimize_scalar  # slow to import and rarely needed

        bounds = (0.0, largest)
        best = float(minimize_scalar(lambda g: contraction(order, axis, angle, g), bounds=bounds, method="bounded").x)
    return GimbalAxis(
        axis=row["axis"],
        angle=angle,
        drift=drift,
        predicted=drift[0] * remaining ** np.arange(len(drift)),
        gain=float(row["gain"]),
        largest=largest,
        best=best,
        contraction=remaining,
        best_contraction=contraction(order, axis, angle, best),
        done=bool(drift[-1] < threshold),
    )
