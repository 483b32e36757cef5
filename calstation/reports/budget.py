"""Uncertainty budget of a result: the share of each source in the variance of every quantity."""

from collections.abc import Mapping
from dataclasses import dataclass

#: Sources in the order of a budget. ``measured`` is noise that the data showed beyond that of the profiles.
SOURCES = ("sensor_noise", "quantisation", "bias_instability", "angles", "motion", "gravity", "prior", "measured")


@dataclass(frozen=True)
class Budget:
    """Contributions to the variance of the quantities."""

    #: Variance from each source by quantity, SI squared; the sum is the variance of the quantity.
    variance: Mapping[str, Mapping[str, float]]
